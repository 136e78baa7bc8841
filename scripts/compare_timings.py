#!/usr/bin/env python3
"""Timings of this project against what else a user could pick, all in one run.

    scripts/compare_timings.py all [--quick] [-o OUT]      # every comparison
    scripts/compare_timings.py whole [--quick] [-o OUT]     # one of them

writes OUT/whole.json ... and prints tables; `report_timings.py` makes pages of such files.
Each comparison is a module of `timings` with `register(commands)` and `tables(results)`; see
`timings.results` for what they share.
"""

from __future__ import annotations

import argparse
import sys
import time

from timings import batch, methods, people, whole
from timings.results import add_command, add_timing_flags

from psfs.cli.commandline import add_message_flags, stderr
from psfs.cli.program import run_command

#: The modules of the comparisons, in the order of `all`.
COMPARISONS = (whole, methods, people, batch)
#: Their shares of a limited time.
_SHARES = {"whole": 4.0, "methods": 2.0, "people": 1.0, "batch": 0.5}


def _run_all(args: argparse.Namespace, others: dict[str, argparse.ArgumentParser]) -> None:
    began = time.monotonic()
    left = dict(others)
    for name, parser in others.items():
        shares = sum(_SHARES[other] for other in left)
        argv = ["--out", str(args.out)]
        argv += [f"--{flag}" for flag in ("quick", "resume", "verbose") if getattr(args, flag)]
        argv += ["--commit", args.commit] if args.commit else []
        if args.seconds is not None:
            seconds = max(0.0, args.seconds - (time.monotonic() - began))
            argv += ["--seconds", f"{seconds * _SHARES[name] / shares:.0f}"]
        stderr.print(f"{name} {' '.join(argv)}", style="bold")
        parsed = parser.parse_args(argv)
        parsed.run(parsed)
        del left[name]


def main() -> int:
    parser = argparse.ArgumentParser(prog="compare_timings.py", description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True, metavar="WHAT")
    for module in COMPARISONS:
        module.register(commands)
    others = dict(commands.choices)
    add_timing_flags(
        add_command(commands, "all", lambda args: _run_all(args, others), help="all of them")
    )
    for command in commands.choices.values():
        add_message_flags(command)
    return run_command(parser)


if __name__ == "__main__":
    sys.exit(main())
