#!/usr/bin/env python3
"""Tracking errors of a suite of sequences against their truth.

    scripts/accuracy.py --suite FOLDER [--seeds 5] [--start found true measured] [--processes 4]
        [--by triangulation voxels keypoints both] [--preset song] [--ablation] [--soft-scenes]
        [--dataset biocv] [-o OUT]
    scripts/accuracy.py -o OUT --readme

tracks every sequence with truth.npz in FOLDER, from nothing but its pictures and from the true
first joints, and writes OUT/suite.md, suite.csv, suite.png, runs.csv and results.json. A second
call with the same OUT continues where the first stopped. `--readme` writes the tables of
docs/accuracy.md from OUT/results.json.
"""

from __future__ import annotations

import argparse
import sys
from contextlib import ExitStack
from importlib.metadata import version
from pathlib import Path
from typing import Any

from accuracy.ablation import ABLATIONS, READINGS
from accuracy.datasets import DATASETS, prepare_dataset
from accuracy.processes import do_jobs, start_workers
from accuracy.published import publish_suite
from accuracy.runs import OBSERVATIONS, Results, Setting
from accuracy.scenes import SOFT_SCENES, make_scenes
from accuracy.suite import (
    STARTS,
    Job,
    KeptSilhouettes,
    Outcome,
    lacking_jobs,
    silhouettes_name,
    suite_folders,
    suite_settings,
)
from accuracy.suite_report import suite_grid, suite_rows, write_suite
from timings.results import checked_out_commit

from apf.filters.config import FilterConfig
from apf.presets import PRESETS
from cl import Device, InputError, UserError, select_device
from psfs.cli.commandline import add_message_flags, progress_bar, stdout
from psfs.cli.program import run_command

_ROOT = Path(__file__).resolve().parent.parent


def main() -> int:
    parser = argparse.ArgumentParser(prog="accuracy.py", description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--suite", type=Path, metavar="FOLDER", help="of sequences with truth.npz")
    add("-o", "--out", type=Path, default=Path("accuracy"), metavar="OUT")
    add("--seeds", type=int, default=5, metavar="N")
    starts = "found, true joints, or these with the girths of voxels (found true)"
    add("--start", nargs="+", choices=STARTS, default=STARTS[:2], help=starts)
    observations = "triangulated keypoints, voxels, keypoints in their place, both (voxels)"
    add("--by", nargs="+", choices=OBSERVATIONS, default=["voxels"], help=observations)
    presets = [*PRESETS, *READINGS]
    add("--preset", action="append", default=[], choices=presets, help="a paper's settings, too")
    add("--presets-only", action="store_true", help="without the defaults")
    add("--ablation", action="store_true", help="the defaults without each of their parts, too")
    add("--particles", type=int, default=FilterConfig().search.n_particles, metavar="N")
    add("--layers", type=int, default=FilterConfig().search.n_layers, metavar="N")
    data = "its trials in the folder of --suite, made into OUT/sequences"
    add("--dataset", choices=DATASETS, help=data)
    soft = "generate the papers' conditions in the suite's folder if they are not there"
    add("--soft-scenes", action="store_true", help=soft)
    add("--processes", type=int, default=1, metavar="P", help="at once (1)")
    add("--scheduler", metavar="ADDRESS", help="on the workers of a Dask cluster")
    add("--seconds", type=float, metavar="S", help="begin no run after so many seconds")
    add("--readme", action="store_true", help="no run; the tables of docs/accuracy.md from OUT")
    add("--commit", help="the commit, where there is no git to ask")
    add_message_flags(parser)
    parser.add_argument("--device", default="auto", help="as of apf track (default: auto)")
    parser.set_defaults(run=_run, overwrite=True)  # its own tables, in any checkout
    return run_command(parser)


def _run(args: argparse.Namespace) -> None:
    for flag, value in (("--seeds", args.seeds), ("--processes", args.processes)):
        if value < 1:
            raise InputError(f"{flag} {value}; expected at least 1")
    if args.presets_only and not args.preset:
        raise InputError("--presets-only without --preset; expected at least one")
    if args.readme == (args.suite is not None):
        raise InputError("expected either --suite FOLDER or --readme")
    if args.readme:
        publish_suite(_ROOT, Results.read(args.out / "results.json"))
        return
    device = select_device(args.device)
    if not isinstance(device, Device):
        raise InputError("--device numpy would take days; expected an OpenCL device")
    _run_suite(args, device)


def _conditions(args: argparse.Namespace, device: Device, folders: list[Path]) -> dict[str, Any]:
    """Return the conditions of the runs besides their settings."""
    return {
        "version": version("psfs-apf"),
        "commit": args.commit or checked_out_commit(),
        "device": device.name,
        "filter": FilterConfig().settings,
        "folders": {folder.name: str(folder) for folder in folders},
    }


def _run_suite(args: argparse.Namespace, device: Device) -> None:
    """Do all runs of the suite that OUT lacks, then write its reports, also after an interrupt."""
    if args.soft_scenes:
        make_scenes(args.suite, SOFT_SCENES, device)
    if args.dataset is not None:
        args.suite = prepare_dataset(args.dataset, args.suite, args.out / "sequences")
    folders = suite_folders(args.suite)
    first = {"method": "apf", "objective": "voxel"}
    first |= {"particles": args.particles, "layers": args.layers}
    presets = ([] if args.presets_only else [""]) + args.preset
    presets += list(ABLATIONS) if args.ablation else []
    settings = dict(suite_settings(folders, args.start, args.by, first, presets))
    conditions = _conditions(args, device, folders)
    results = Results.resume(args.out / "results.json", conditions)
    same = {name: conditions[name] for name in ("version", "commit", "device")}
    silhouettes = KeptSilhouettes(args.out / "silhouettes", same)
    jobs = lacking_jobs(
        settings, results, args.seeds, lambda name: silhouettes.select(name) is not None
    )
    errors: list[str] = []
    try:
        with ExitStack() as stack:
            client = None
            if jobs and (args.processes > 1 or args.scheduler is not None):
                workers = start_workers(args.out, args.device, args.processes, args.scheduler)
                client = stack.enter_context(workers)
            bar = stack.enter_context(progress_bar())
            task = bar.add_task("suite", total=len(jobs))

            def keep(job: Job, outcome: Outcome | UserError) -> None:
                if isinstance(outcome, UserError):
                    errors.append(f"{job.folder.name}: {outcome}")
                elif isinstance(outcome, dict):
                    silhouettes.add(job.silhouettes, outcome)
                else:
                    for run in outcome:
                        results.add(run)
                bar.advance(task)

            do_jobs(jobs, device, client, keep, args.seconds)
    finally:

        def iou(setting: Setting) -> float:
            return silhouettes.iou(silhouettes_name(setting.sequence, setting.preset))

        rows = suite_rows(results, list(settings), iou)
        if rows:
            write_suite(args.out, results, rows)
            suite_grid(rows).show()
            stdout.print(f"{len(results.runs)} runs: {args.out}")
    if errors:
        raise InputError("; ".join(dict.fromkeys(errors)))


if __name__ == "__main__":
    sys.exit(main())
