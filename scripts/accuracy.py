#!/usr/bin/env python3
"""Tracking errors against the truth, over cameras, frame rates, particles, layers, objectives.

    scripts/accuracy.py [FOLDER ...] [--tables cameras step particles:layers] [-o OUT]

    scripts/accuracy.py FOLDER --thesis [--seconds 250] [-o OUT]

    scripts/accuracy.py --suite FOLDER [--seeds 5] [--start found true measured] [--soft-scenes]
        [--processes 4] [--dataset biocv]
        [--by triangulation voxels keypoints both] [--preset song] [--ablation] [-o OUT]

tracks every sequence with truth.npz in FOLDER, from nothing but its pictures and from the true
first joints: OUT/suite.md, suite.csv, suite.png, runs.csv, results.json. The others write
OUT/results.json (all runs), runs.csv, tables.csv, tables.md (or thesis.md) and accuracy.png,
and print tables. Without folders they generate their own walks. A second call with the same OUT
continues where the first stopped.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from contextlib import ExitStack
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from accuracy.ablation import ABLATIONS, READINGS, load_preset
from accuracy.datasets import DATASETS, prepare_dataset
from accuracy.processes import do_jobs, start_workers
from accuracy.published import publish_suite
from accuracy.recordings import Recording, record
from accuracy.report import grids, headline, joints, plot, write_summary, write_tables
from accuracy.runs import Results, run, together
from accuracy.scenes import OWN_WALKS, SOFT_SCENES, make_scenes
from accuracy.settings import DEFAULT_TABLES, DIMENSIONS, OBSERVATIONS, Setting, Table
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
from accuracy.thesis import TABLES as THESIS
from accuracy.thesis import publish_thesis, thesis_plan, write_thesis
from timings.report.readme import replace_marked
from timings.results import checked_out_commit
from timings.tables.grid import Grid

from apf.filters.config import FilterConfig
from apf.filters.objectives import OBJECTIVES
from apf.filters.searches import SEARCHES
from apf.filters.term_weights import TERMS
from apf.presets import PRESETS
from apf.tracking.track import spans
from cl import Device, InputError, UserError, select_device
from psfs.cli.commandline import add_device_flag, add_message_flags, progress_bar, stdout
from psfs.cli.program import run_command
from psfs.sequence import Sequence

_ROOT = Path(__file__).resolve().parent.parent


def numbers(text: str) -> list[int]:
    """Parse `8,4,3` to [8, 4, 3] (argparse type)."""
    try:
        values = [int(part) for part in text.split(",")]
        if min(values) < 1:
            raise ValueError
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}; expected numbers from 1 on, a,b,c") from None
    return list(dict.fromkeys(values))


def names(text: str) -> list[str]:
    """Parse `a,b` to ["a", "b"] (argparse type)."""
    return list(dict.fromkeys(text.split(",")))


def main() -> int:
    parser = argparse.ArgumentParser(prog="accuracy.py", description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER", help="with truth.npz")
    parser.add_argument("-o", "--out", type=Path, default=Path("accuracy"), metavar="OUT")
    parser.add_argument(
        "--tables",
        nargs="+",
        default=list(DEFAULT_TABLES),
        metavar="A:B",
        help=f"dimensions varied together, the last in columns, out of {', '.join(DIMENSIONS)}",
    )
    group = parser.add_argument_group("values", "the first one holds where it is not varied")
    group.add_argument("--cameras", type=numbers, default=[8, 4, 3, 2])
    group.add_argument("--step", type=numbers, default=[1, 2, 4], help="every n-th frame")
    group.add_argument("--particles", type=numbers, default=[200, 50, 100, 400])
    group.add_argument("--layers", type=numbers, default=[10, 5])
    group.add_argument("--method", type=names, default=["apf"], help=", ".join(SEARCHES))
    group.add_argument(
        "--objective",
        type=names,
        default=["voxel", "edge+silhouette", "edge+silhouette+surface", "surface"],
        help=f"{', '.join(OBJECTIVES)}, or terms of the voxels' likelihood joined by +: "
        f"{', '.join(TERMS)}",
    )
    parser.add_argument("--seeds", type=int, default=10, metavar="N")
    parser.add_argument(
        "--thesis",
        nargs="*",
        choices=list(THESIS),
        help="instead, these tables of Rymut's thesis, all by default, on one FOLDER; into "
        "thesis.md, too",
    )
    parser.add_argument(
        "--suite", type=Path, metavar="FOLDER", help="instead, all sequences with truth in it"
    )
    parser.add_argument(
        "--preset",
        action="append",
        default=[],
        choices=[*PRESETS, *READINGS],
        help="a paper's settings, too, with --suite; with --thesis in the defaults' place",
    )
    parser.add_argument("--presets-only", action="store_true", help="without the defaults")
    _add_suite_flags(parser.add_argument_group("of --suite"))
    parser.add_argument(
        "--readme",
        action="store_true",
        help="instead of any run: the README's table from OUT/results.json of a suite; of presets "
        "alone, beside OUT/../suite, and of other runs the tables of docs/accuracy.md",
    )
    parser.add_argument(
        "--seconds", type=float, metavar="S", help="begin no run after so many seconds"
    )
    parser.add_argument("--commit", help="the commit, where there is no git to ask")
    add_message_flags(parser)
    add_device_flag(parser)
    parser.set_defaults(run=_run, overwrite=True)  # its own tables, in any checkout
    return run_command(parser)


def _add_suite_flags(group: argparse._ArgumentGroup) -> None:
    starts = "found, true joints, or these with the girths of voxels (found true)"
    group.add_argument("--start", nargs="+", choices=STARTS, default=STARTS[:2], help=starts)
    data = "its trials in the folder of --suite, made into OUT/sequences"
    group.add_argument("--dataset", choices=DATASETS, help=data)
    soft = "generate the papers' conditions in the suite's folder if they are not there"
    group.add_argument("--soft-scenes", action="store_true", help=soft)
    group.add_argument(
        "--by",
        nargs="+",
        choices=OBSERVATIONS,
        default=["voxels"],
        help="the observations to compare: keypoints triangulated, voxels, keypoints in their "
        "place, both; those of keypoints where a sequence has some (voxels)",
    )
    ablated = "the defaults without each of their parts, too"
    group.add_argument("--ablation", action="store_true", help=ablated)
    group.add_argument("--processes", type=int, default=1, metavar="P", help="at once (1)")
    group.add_argument("--scheduler", metavar="ADDRESS", help="on the workers of a Dask cluster")


def _run(args: argparse.Namespace) -> None:
    if args.seeds < 1:
        raise InputError(f"--seeds {args.seeds}; expected at least 1")
    if args.dataset is not None and args.suite is None:
        raise InputError(f"--dataset {args.dataset} without --suite; expected its folder there")
    if args.suite is not None:
        _check_suite(args)
    elif args.readme:
        update_readme(args)
        return
    device = select_device(args.device)
    if not isinstance(device, Device):
        raise InputError("--device numpy would take days; expected an OpenCL device")
    if args.suite is not None:
        _run_suite(args, device)
        return
    folders = [folder.resolve() for folder in args.folders]
    if args.thesis is not None:
        if len(folders) != 1 or len(args.preset) > 1:
            found = f"{len(folders)} folders and {len(args.preset)} presets"
            raise InputError(f"--thesis with {found}; expected one folder, and one preset at most")
        plan = thesis_plan(
            folders[0], len(Sequence.open(folders[0]).rig), args.thesis or list(THESIS),
            args.preset[0] if args.preset else "",
        )  # fmt: skip
    else:
        folders = folders or make_scenes(args.out / "scenes", OWN_WALKS, device)
        tables = [Table.parse(text) for text in args.tables]
        plan = _plan(folders, tables, {name: getattr(args, name) for name in DIMENSIONS})
    conditions = _conditions(args, device, folders)
    results = Results.resume(args.out / "results.json", conditions)
    by_name = {folder.name: folder for folder in folders}
    try:
        do_runs(device, by_name, plan, results, args)
    finally:  # write the results so far, also after an interrupt
        if results.runs:
            results.write_csv(args.out / "runs.csv")
            write_summary(args.out / "tables.csv", plan, results)
            plot(args.out / "accuracy.png", plan, results)
            shown = _print_tables(plan, results)
            for grid in shown:
                grid.show()
            if args.thesis is not None:
                write_thesis(args.out / "thesis.md", results)
            else:
                write_tables(args.out / "tables.md", shown, results)
            stdout.print(f"{len(results.runs)} runs: {args.out}", soft_wrap=True)


def _conditions(args: argparse.Namespace, device: Device, folders: list[Path]) -> dict[str, Any]:
    """Return the conditions of the runs besides their settings."""
    return {
        "version": version("psfs-apf"),
        "commit": args.commit or checked_out_commit(),
        "device": device.name,
        "filter": FilterConfig().settings,
        "folders": {folder.name: str(folder) for folder in folders},
    }


def _check_suite(args: argparse.Namespace) -> None:
    if args.folders or args.thesis is not None or args.readme:
        raise InputError("--suite with folders, --thesis or --readme; expected it alone")
    if args.presets_only and not args.preset:
        raise InputError("--presets-only without --preset; expected at least one")
    if args.processes < 1:
        raise InputError(f"--processes {args.processes}; expected at least 1")


def _run_suite(args: argparse.Namespace, device: Device) -> None:
    """Do all runs of the suite that OUT lacks, then write its reports, also after an interrupt."""
    if args.soft_scenes:
        make_scenes(args.suite, SOFT_SCENES, device)
    if args.dataset is not None:
        args.suite = prepare_dataset(args.dataset, args.suite, args.out / "sequences")
    folders = suite_folders(args.suite)
    varied = ("method", "objective", "particles", "layers")
    first = {name: getattr(args, name)[0] for name in varied}
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
            stdout.print(f"{len(results.runs)} runs: {args.out}", soft_wrap=True)
    if errors:
        raise InputError("; ".join(dict.fromkeys(errors)))


def _print_tables(plan: dict[Table, list[Setting]], results: Results) -> list[Grid]:
    """Print the tables, and for every sequence the joints in its first setting."""
    firsts = [s for s in _first_settings(plan) if results.select(s)]
    return [*grids(plan, results), *(joints(s, results.select(s)) for s in firsts)]


def update_readme(args: argparse.Namespace) -> None:
    """Write README's table from a suite, or the tables of docs/accuracy.md from other runs."""
    results = Results.read(args.out / "results.json")
    if args.thesis is not None:
        publish_thesis(_ROOT, results)
        return
    if (args.out / "suite.md").is_file():
        publish_suite(_ROOT, results)
        return
    values = {name: getattr(args, name) for name in DIMENSIONS}
    plan: dict[Table, list[Setting]] = {}
    for table in map(Table.parse, args.tables):
        names = dict.fromkeys(run.setting.sequence for run in results.runs)
        settings = [setting for name in names for setting in table.settings(name, values)]
        plan[table] = [setting for setting in settings if results.select(setting)]
    write_tables(args.out / "tables.md", _print_tables(plan, results), results)
    replace_marked(_ROOT / "docs" / "accuracy.md", "cameras", headline(plan, results))


def _plan(
    folders: list[Path], tables: list[Table], values: dict[str, list[Any]]
) -> dict[Table, list[Setting]]:
    """Return the settings of each table. Numbers of cameras that a sequence lacks are left out."""
    if len({folder.name for folder in folders}) < len(folders):
        raise InputError("two folders have the same name; expected different ones")
    plan: dict[Table, list[Setting]] = {table: [] for table in tables}
    for folder in folders:
        n_cameras = len(Sequence.open(folder).rig)
        fitting = [count for count in values["cameras"] if count <= n_cameras]
        if not fitting:
            raise InputError(f"{folder}: has {n_cameras} cameras; expected {values['cameras']}")
        for table in tables:
            plan[table] += table.settings(folder.name, {**values, "cameras": fitting})
    return plan


def _first_settings(plan: dict[Table, list[Setting]]) -> list[Setting]:
    """Return each sequence's setting with all dimensions at their first value."""
    first: dict[str, Setting] = {}
    for settings in plan.values():
        for setting in settings:
            first.setdefault(setting.sequence, setting)
    return list(first.values())


def do_runs(
    device: Device,
    folders: dict[str, Path],
    plan: dict[Table, list[Setting]],
    results: Results,
    args: argparse.Namespace,
) -> None:
    """Do the missing runs, those of one recording together, seed by seed, up to the time limit."""
    end = time.monotonic() + (args.seconds or math.inf)
    todo = lacking(device, plan, results, args.seeds)
    with progress_bar() as bar:
        task = bar.add_task("runs", total=sum(len(part) for _, part in todo))
        shown: tuple[str, int, int, str] | None = None
        recording: Recording | None = None
        for setting, part in todo:
            if time.monotonic() > end:
                return
            wanted = setting.recording
            if recording is None or wanted != shown:
                of = silhouettes_name(setting.sequence, setting.preset)
                name = f"{of}_{setting.cameras}cam_step{setting.step}.npz"
                bar.update(task, description=f"voxels of {name.removesuffix('.npz')}")
                folder, cache = folders[setting.sequence], args.out / "clouds" / name
                frames = bar.add_task("frames")
                advance = partial(bar.advance, frames)
                settings = load_preset(setting.preset) if setting.preset else None
                recording = record(device, folder, *wanted[1:3], cache, advance, settings=settings)
                bar.remove_task(frames)
                shown = wanted
            bar.update(task, description=_describe(setting, part))
            for done in run(device, recording, setting, part):
                results.add(done)
            bar.advance(task, len(part))


def lacking(
    device: Device, plan: dict[Table, list[Setting]], results: Results, seeds: int
) -> list[tuple[Setting, list[int]]]:
    """Return the missing settings with the seeds to track at once, in the order of the runs."""
    settings = dict.fromkeys(setting for part in plan.values() for setting in part)
    left = {s: [k for k in range(seeds) if results.lacks(s, k)] for s in settings}
    todo = [(s, part) for s, rest in left.items() for part in together(device, s, rest) if part]
    return sorted(todo, key=lambda item: (item[0].recording, item[1][0]))


def _describe(setting: Setting, seeds: list[int]) -> str:
    return (
        f"{setting.sequence}, {setting.cameras} cameras, 1/{setting.step} frames, "
        f"{setting.method} {setting.objective} {setting.particles} x {setting.layers}, "
        f"seeds {spans(seeds)}"
    )


if __name__ == "__main__":
    sys.exit(main())
