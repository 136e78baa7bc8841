#!/usr/bin/env python3
"""Tables of what compare_timings.py measured.

    scripts/report_timings.py [FOLDER ...] [-o OUT] [--readme]

makes OUT/report.md from folders of results, one per machine: by default those in
scripts/results/. With --readme also docs/speed.md's table between its marks, and its picture
docs/timings.png.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from timings.report import (
    headline_figure,
    read_batches,
    read_machines,
    update_page,
    write_figure,
    write_report,
)

from psfs.cli.commandline import add_message_flags, stdout
from psfs.cli.program import run_command

_ROOT = Path(__file__).resolve().parent.parent
_RESULTS = _ROOT / "scripts" / "results"


def main() -> int:
    parser = argparse.ArgumentParser(prog="report_timings.py", description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("-o", "--out", type=Path, default=_RESULTS, metavar="OUT")
    parser.add_argument("--readme", action="store_true", help="bring docs/speed.md up to date")
    add_message_flags(parser)
    parser.set_defaults(run=_run, overwrite=True)  # its own tables, in any checkout
    return run_command(parser)


def _run(args: argparse.Namespace) -> None:
    held = {path.parent for name in ("whole", "batch") for path in _RESULTS.glob(f"*/{name}.json")}
    folders = args.folders or sorted(held)
    machines = read_machines(folders)
    more = [
        machine
        for machine in read_batches(folders)
        if machine.name not in {m.name for m in machines}
    ]
    write_report([*machines, *more], args.out / "report.md")
    stdout.print(f"wrote {args.out / 'report.md'}")
    if args.readme:
        picture = _ROOT / "docs" / "timings.png"
        write_figure(headline_figure(machines), picture)
        update_page(_ROOT / "docs" / "speed.md", machines)
        stdout.print(f"wrote docs/speed.md and {picture}")


if __name__ == "__main__":
    sys.exit(main())
