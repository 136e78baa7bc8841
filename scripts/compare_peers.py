#!/usr/bin/env python3
"""Other programs beside ours on the same keypoints: Pose2Sim, aniposelib, FreeMoCap's filter.

    scripts/compare_peers.py SUITE [-o OUT] [--programs NAME ...] [--seeds 1]
    scripts/compare_peers.py SUITE -o OUT --tables

makes an environment for each peer from PyPI (2 and 1 GB; `--environments FOLDER` keeps them), feeds
all programs the keypoints.npz of every sequence of SUITE that has some and a truth.npz, and writes
OUT/peers.json (every run, with versions and seconds), peers.csv and peers.md. A second call with
the same OUT does what is missing. `--tables` writes the tables of the runs so far, and
those of docs/accuracy.md. The peers'
settings are those of their own demos and documentation, see `scripts/peers/programs.py`. Sequences
without keypoints are named and left out: no network runs here.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

from peers.environments import PACKAGES, list_versions, make_environment
from peers.figures import measure
from peers.programs import NEEDS, PROGRAMS, Task
from peers.results import (
    PeerResults,
    PeerRun,
    print_tables,
    replace_suite_runs,
    summary_table,
    write_tables,
)
from timings.grid import replace_marked
from timings.results import checked_out_commit

from apf.evaluation.truth import load_truth
from cl import Device, InputError, UserError, select_device
from psfs.cli.commandline import add_message_flags, stderr, warn
from psfs.cli.program import run_command
from psfs.sequence import Sequence

_ROOT = Path(__file__).resolve().parent.parent
#: Programs whose result depends on a seed.
_RANDOM = ("ours: keypoints", "ours: voxels", "ours: both")


def main() -> int:
    parser = argparse.ArgumentParser(prog="compare_peers.py", description=__doc__.splitlines()[0])
    parser.add_argument("suite", type=Path, metavar="SUITE", help="a folder of sequences")
    parser.add_argument("-o", "--out", type=Path, default=Path("peers"), metavar="OUT")
    parser.add_argument(
        "--programs", nargs="+", choices=list(PROGRAMS), default=list(PROGRAMS), metavar="NAME",
        help=f"of {', '.join(PROGRAMS)}; all by default",
    )  # fmt: skip
    parser.add_argument("--sequences", nargs="+", metavar="NAME", help="of the suite; all")
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="of our filter (1)")
    parser.add_argument(
        "--environments", type=Path, default=Path("peers-environments"), metavar="FOLDER",
        help="where the peers are installed",
    )  # fmt: skip
    parser.add_argument(
        "--tables", nargs="?", const="peers", metavar="MARK",
        help="no run; tables, also that of docs/accuracy.md between the marks of this name (peers)",
    )  # fmt: skip
    parser.add_argument(
        "--ours-from", type=Path, metavar="FILE",
        help="results.json of accuracy.py --suite --by: our runs on the same keypoints, replacing "
        "those of OUT by --programs",
    )  # fmt: skip
    parser.add_argument("--commit", help="the commit, where there is no git to ask")
    add_message_flags(parser)
    parser.add_argument("--device", default="auto", help="as of apf track (default: auto)")
    parser.set_defaults(run=_run, overwrite=True)  # its own tables, in any checkout
    return run_command(parser)


def _run(args: argparse.Namespace) -> None:
    results = PeerResults.read(args.out / "peers.json")
    if args.ours_from is not None:
        replace_suite_runs(results, args.ours_from, args.programs)
    if not args.tables:
        _do_runs(args, results)
    if not results.runs:
        raise InputError(f"{args.out}: no runs; expected a suite with keypoints.npz and truth.npz")
    write_tables(args.out, results)
    if args.tables:
        shown = summary_table(results).markdown()
        replace_marked(_ROOT / "docs" / "accuracy.md", args.tables, shown)
    print_tables(results)


def _do_runs(args: argparse.Namespace, results: PeerResults) -> None:
    if args.seeds < 1:
        raise InputError(f"--seeds {args.seeds}; expected at least 1")
    sequences = _sequences(args.suite, args.sequences)
    needed = dict.fromkeys(NEEDS[name] for name in args.programs if name in NEEDS)
    pythons = {
        peer: make_environment(args.environments, peer) for peer in PACKAGES if peer in needed
    }
    for peer, python in pythons.items():
        results.versions[peer] = list_versions(python, peer)
    device = select_device(args.device)
    commit = args.commit or checked_out_commit() or "unknown"
    for folder in sequences:
        sequence, truth = Sequence.open(folder), load_truth(folder / "truth.npz")
        for program in args.programs:
            for seed in range(args.seeds if program in _RANDOM else 1):
                if results.has(folder.name, program, seed):
                    continue
                stderr.print(f"{folder.name}: {program}, seed {seed}")
                on = device if program in _RANDOM and isinstance(device, Device) else None
                task = Task(sequence, args.out / "work" / folder.name, pythons, on, seed)
                where = on.name if on is not None else "one core"
                run = PeerRun(folder.name, program, seed, where, commit)
                try:
                    found = PROGRAMS[program](task)
                    figures = measure(found.joints, truth)
                    run = replace(run, figures=figures, cpu=found.cpu, clock=found.clock)
                except UserError as error:
                    warn(f"{folder.name}: {program}: {error}", stderr)
                    run = replace(run, failed=str(error))
                results.add(run)


def _sequences(suite: Path, names: list[str] | None) -> list[Path]:
    """Return the folders with truth and keypoints. Raises InputError if there are none."""
    folders = sorted(path.parent.resolve() for path in suite.glob("*/truth.npz"))
    if names is not None:
        folders = [folder for folder in folders if folder.name in names]
    given = [folder for folder in folders if (folder / "keypoints.npz").is_file()]
    lacking = [folder.name for folder in folders if folder not in given]
    if lacking:
        warn(f"without keypoints.npz, left out: {', '.join(lacking)}", stderr)
    if not given:
        raise InputError(f"{suite}: no sequence with truth.npz and keypoints.npz")
    return given


if __name__ == "__main__":
    sys.exit(main())
