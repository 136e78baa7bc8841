"""`apf track`: a skeleton per frame."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np

from apf.api import given_start, template_of
from apf.backend import check_renderer
from apf.body import BodyModel, save_body
from apf.cli.first_pose import check_start, naming_init, warn_of_doubts
from apf.cli.keypoints.flags import keypoints_of
from apf.cli.keypoints.triangulate import TRIANGULATE, run_triangulate
from apf.cli.method_flags import METHOD_FLAGS, chosen_method
from apf.cli.takes.kept_parts import Keeper, remove_parts
from apf.cli.takes.take_report import Judgement, Line, TakeLine, TakeReport, was_interrupted
from apf.filters.method import Method
from apf.formats.pose import write_pose
from apf.report.judged import FILES, judge_track, run_facts, write_report
from apf.report.names import PAGE
from apf.report.quality import Quality
from apf.report.summary import SUMMARY
from apf.results.evaluate import evaluate, load_truth
from apf.results.overlay import write_overlay
from apf.tracking.batch import Take, at_once, check_cameras, track_take
from apf.tracking.track import PARTS, Track, spans
from apf.tracking.trackers import seeded
from cl import Device, InputError, NumpyDevice, UserError, select_device
from psfs.cli.commandline import progress_bar, stderr, stdout
from psfs.cli.sequence_flags import (
    chosen_frames,
    open_sequence,
    open_trusted,
    selected_frames,
    stated,
)
from psfs.cli.settings import refuse_unused, write_settings
from psfs.common.files import resolve_path
from psfs.common.outputs import OutputFolder, output_folder
from psfs.diagnostics.camera_consistency import Suspect
from psfs.output.runs import sequence_facts
from psfs.reconstructor import ReconstructionConfig

#: Runs that --seeds may ask for.
MOST_SEEDS = 1000
#: What a take is written to.
RESULTS = (*FILES, SUMMARY, PAGE, PARTS)


def run(args: argparse.Namespace) -> None:
    if args.method == TRIANGULATE:
        run_triangulate(args, take_names([Path(folder) for folder in args.folders]))
        return
    method = chosen_method(args)
    seeds = chosen_seeds(args, method)
    check_start(args)
    if args.at_once is not None and args.at_once < 1:
        raise InputError(f"--at-once is {args.at_once}; expected at least 1")
    if len(args.folders) == 1:
        refuse_unused(args, ["at_once"], "is of several takes; expected more than one")
    if len(args.folders) > 1:
        _run_many(args, method, seeds)
        return
    device = select_device(args.device)
    check_renderer(device, method)
    bar = progress_bar()  # which the first frame starts

    def stop() -> None:
        if bar.live.is_started:  # stopping prints a line
            bar.stop()

    track_one(args, device, TakeLine(bar), stop)


def track_one(
    args: argparse.Namespace,
    device: Device | NumpyDevice,
    line: Line,
    before_words: Callable[[], object] = lambda: None,
) -> Take:
    """Track the one take that the flags name on `device`, write its files and print what was found.

    before_words: called when the line has ended and nothing is printed yet. Raises UserError, and
    KeyboardInterrupt after writing what is tracked where `line` raised one.
    """
    method = chosen_method(args)
    seeds = chosen_seeds(args, method)
    check_start(args)
    job = argparse.Namespace(**{**vars(args), "folder": args.folders[0]})
    with output_folder(args.output, args.parser.prog, _inputs(job), RESULTS) as out:
        try:
            take, left_out = _tracked(out, job, device, method, seeds, line)
            judgements = finish_take(job, device, take, left_out, seeds, line)
        finally:
            before_words()
        _raise_error(take, line.n_frames, args.output)
        for judgement in judgements:
            print_outcome(judgement, line.n_frames)
        if was_interrupted(take.tracks[0], line.n_frames):
            raise KeyboardInterrupt
        for line_of_spread in spread_of(take):
            stdout.print(line_of_spread)
    return take


def _run_many(args: argparse.Namespace, method: Method, seeds: list[int]) -> None:
    """Every folder into its own, some at once; a table of all, also of interrupted ones. Raises
    InputError if one failed."""
    if args.init is not None:
        raise InputError("--init is the first pose of one take; expected none with several")
    names = take_names([Path(folder) for folder in args.folders])
    device = select_device(args.device)
    check_renderer(device, method)
    report, bar = TakeReport(names), progress_bar()
    overall = bar.add_task("takes", total=len(names))

    def work(own: Device | NumpyDevice, number: int, check: Callable[[], None]) -> None:
        name = names[number]
        own_folders = {"folder": args.folders[number], "output": args.output / name}
        job = argparse.Namespace(**{**vars(args), **own_folders})
        with (
            closing(TakeLine(bar, name, check)) as line,
            output_folder(job.output, args.parser.prog, _inputs(job), RESULTS) as out,
        ):
            take, left_out = _tracked(out, job, own, method, seeds, line)
            judgements = finish_take(job, own, take, left_out, seeds, line)
            _raise_error(take, line.n_frames, job.output)
            report.tracked(name, take, line.n_frames, judgements, spread_of(take))
            if was_interrupted(take.tracks[0], line.n_frames):
                raise KeyboardInterrupt

    folders = [Path(folder) for folder in args.folders]
    try:
        with (
            output_folder(args.output, args.parser.prog, folders) as outer,
            bar,
            closing(at_once(device, work, len(names), args.at_once)) as outcomes,
        ):
            outer.begin()  # what one take left here is no result of these
            for number, outcome in outcomes:
                if isinstance(outcome, UserError):
                    report.failed(names[number], outcome)
                stderr.print(report.line(names[number]), soft_wrap=True)
                bar.advance(overall)
    finally:
        report.show()
    if report.errors:
        failed = ", ".join(name for name in names if name in report.errors)
        raise InputError(f"{len(report.errors)} of {len(names)} takes failed: {failed}")


def _inputs(args: argparse.Namespace) -> list[Path]:
    """Return the files and folders that are read, as far as the flags name them."""
    stated = [Path(path) for path in (args.init, args.body) if path is not None]
    return [Path(args.folder), *(path for path in stated if path.exists())]


def _tracked(
    out: OutputFolder,
    args: argparse.Namespace,
    device: Device | NumpyDevice,
    method: Method,
    seeds: list[int],
    line: Line,
) -> tuple[Take, list[Suspect]]:
    """The take in `args.folder`, its files written but for those of `finish_take`, and the cameras
    left out."""
    template, own_shape = template_of(args.body)
    if method.uses_images:
        method.image.mesh(template)  # that its files are what they should be
    config = _config(args)
    sequence, left_out = open_sequence(args), list[Suspect]()
    sequence.keep_frames()
    out.check_inputs(sequence.inputs)
    first = chosen_frames(args, sequence)[0]
    given = given_start(sequence.folder, first, args.body, args.init, args.convention)
    if method.uses_voxels:
        check_cameras(sequence)
    # What flags name is read by now: looking at the pictures takes seconds.
    if method.objective != "keypoints":  # which sees nothing of the background
        sequence, left_out = open_trusted(args, device, person=True, opened=sequence)
    frames = selected_frames(args, sequence)
    line.n_frames = len(frames)
    with naming_init(sequence):
        take = track_take(
            device, sequence, method, seeds,
            given=given, template=template, keep_shape=own_shape, height=args.height,
            voxel_size=args.voxel_size,
            selection=slice(frames.start, frames.stop, frames.step),
            reconstruction=config, progress=line, keypoints=keypoints_of(args, sequence),
            keep=Keeper(seed_folders(args, seeds)),
        )  # fmt: skip
    write_track_settings(args, method)
    if take.start is not None:
        warn_of_doubts(sequence, take.start)
    for track, folder in zip(take.tracks, seed_folders(args, seeds), strict=True):
        write_pose(folder / "start.txt", take.pose, take.body)
        write_files(folder, track, take.body)
        remove_parts(folder)
    return take, left_out


def _raise_error(take: Take, n_frames: int, folder: Path) -> None:
    """Raise what ended the tracks early, if anything did."""
    if take.error is not None:
        raise InputError(
            f"{take.error}; {len(take.tracks[0])} of {n_frames} frames are in {folder}"
        ) from take.error


def finish_take(
    args: argparse.Namespace,
    device: Device | NumpyDevice,
    take: Take,
    left_out: list[Suspect],
    seeds: list[int],
    line: Line,
) -> list[Judgement]:
    """Write overlay.mp4, summary.json and report.html beside the other files of every seed, as the
    flags say. A track that was interrupted gets a summary only, without being compared with the
    silhouettes."""
    n_done = len(take.tracks[0])
    whole = not was_interrupted(take.tracks[0], line.n_frames)
    if whole:
        _draw_overlays(args, take, seeds, line)
    reasons = {suspect.camera: str(suspect) for suspect in left_out}
    doubts = take.start.doubts if take.start is not None else []
    warnings = [*getattr(args, "remarks", ()), *doubts]  # keypoints alone are not examined
    sequence = sequence_facts(take.sequence, seed_folders(args, seeds)[0], stated(args), reasons)
    facts = run_facts(
        device, sequence, _config(args), (n_done, line.n_frames), warnings, take.seconds
    )
    found = []
    for track, folder in zip(take.tracks, seed_folders(args, seeds), strict=True):
        quality = Quality(track, None)
        compared = whole and not args.no_report
        if compared:
            line.begin("judging")
            progress = partial(line, "judging")
            quality = judge_track(device, take.sequence, track, _config(args), progress)
        files = write_report(folder, take.sequence.name, quality, facts, page=compared)
        found.append(Judgement(folder, quality, files))
    return found


def _config(args: argparse.Namespace) -> ReconstructionConfig:
    return args.configs.get("reconstruction") or ReconstructionConfig()


def write_track_settings(args: argparse.Namespace, method: Method) -> None:
    """Write the settings of all tracks beside them."""
    configs = {"method": method, "reconstruction": _config(args)}
    write_settings(args.output, args, configs, METHOD_FLAGS)


def _draw_overlays(args: argparse.Namespace, take: Take, seeds: list[int], line: Line) -> None:
    """overlay.mp4 beside the other files of every seed, unless the flags say none."""
    if args.no_overlay:
        return
    for track, folder in zip(take.tracks, seed_folders(args, seeds), strict=True):
        line.begin("overlay")
        write_overlay(
            folder / "overlay.mp4", take.sequence, track, take.body, lambda: line("overlay")
        )


def seed_folders(args: argparse.Namespace, seeds: list[int]) -> list[Path]:
    """Return where the files of every seed's run go."""
    if args.seeds is None:
        return [args.output]
    return [args.output / f"seed{seed}" for seed in seeds]


def take_names(folders: list[Path]) -> list[str]:
    """Return a name for each of the takes: its folder's, with as many of the folders above as
    distinguish them. Raises InputError if one is given twice."""
    paths = [resolve_path(folder) for folder in folders]
    for path in paths:
        if paths.count(path) > 1:
            raise InputError(f"{path} is given twice; expected different takes")
    depth, names = 1, [path.name for path in paths]
    while len(set(names)) < len(names):
        depth += 1
        names = ["_".join(path.parts[-depth:]) for path in paths]
    return names


def chosen_seeds(args: argparse.Namespace, method: Method) -> list[int]:
    """Return the seeds of the runs to make. Raises InputError."""
    n_runs = 1 if args.seeds is None else args.seeds
    if not 1 <= n_runs <= MOST_SEEDS:
        raise InputError(f"--seeds is {n_runs}; expected 1 to {MOST_SEEDS}")
    first = method.filter.search.seed
    seeds = list(range(first, first + n_runs))
    seeded(method, seeds[-1:])
    return seeds


def print_outcome(judgement: Judgement, n_frames: int) -> None:
    """Print what became of `n_frames` that were to be tracked: how good the track is, what to look
    at, and which files were written."""
    track, folder = judgement.quality.track, judgement.folder
    if was_interrupted(track, n_frames):
        stderr.print(f"{len(track)} of {n_frames} frames are in {folder}")
        return
    stdout.print(f"{len(track)} frames tracked: {folder}", soft_wrap=True)
    if len(track.restarts):
        stdout.print(f"found again by a new search in frames {spans(track.restarts.tolist())}")
    for line in judgement.quality.lines():
        stdout.print(line, soft_wrap=True)
    stdout.print(f"wrote {', '.join(judgement.files)}", soft_wrap=True)


def spread_of(take: Take) -> list[str]:
    """Describe how far several runs differ and, where the truth is known, how far they err."""
    tracks = take.tracks
    if len(tracks) == 1:
        return []
    joints = np.stack([track.joints for track in tracks])
    away = 1000 * np.linalg.norm(joints - joints.mean(0), axis=-1)
    lines = [f"{len(tracks)} runs: joints lie {away.mean():.1f} mm from the runs' mean"]
    truth = take.sequence.folder / "truth.npz"
    if truth.exists():
        errors = [1000 * evaluate(track, load_truth(truth)).mean_error for track in tracks]
        spread = f"{np.mean(errors):.1f} ± {np.std(errors, ddof=1):.1f} mm"
        lines.append(f"mean error: {spread}, {min(errors):.1f} to {max(errors):.1f}")
    return lines


def write_files(folder: Path, track: Track, body: BodyModel) -> None:
    """Write track.npz, joints.trc, joints.csv and body.toml into `folder`."""
    track.save(folder / "track.npz")
    track.save(folder / "joints.trc")
    track.save(folder / "joints.csv")
    save_body(folder / "body.toml", body)
