"""`apf evaluate`: compare a track with the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.table import Table

from apf.evaluation.angle_truth import (
    AngleError,
    TrueAngles,
    evaluate_angles,
    load_true_angles,
    mean_error,
)
from apf.evaluation.conventions import axes_that_fit, choose_convention
from apf.evaluation.evaluate import LOST_FRAMES, LOST_JOINT, LOST_LIMB, Evaluation, evaluate
from apf.evaluation.evaluation_plot import write_plot
from apf.evaluation.marker_truth import evaluate_markers, load_markers
from apf.evaluation.people import MATCHED, PeopleEvaluation, evaluate_people, load_followed_truth
from apf.evaluation.truth import is_of_people, load_people_truth, load_truth
from apf.formats.c3d import read_c3d
from apf.formats.trc import JointSeries
from apf.request import EvaluateRequest
from apf.tracking.people import PeopleTracks, holds_people, person_folder
from apf.tracking.track import Track, spans
from cl import InputError
from psfs.cli.commandline import stdout, warn
from psfs.common.files import resolve_path
from psfs.common.outputs import output_folder
from psfs.common.ranges import check_number


def run(request: EvaluateRequest) -> None:
    if request.truth_start is not None:
        check_number("--truth-start, frames,", request.truth_start, -1e9, 1e9)
    if holds_people(request.track):
        _run_people(request)
        return
    if len(request.truth) > 1:
        raise InputError(
            f"{request.track}: the track of one person; expected one file of the truth, found "
            f"{len(request.truth)}"
        )
    track = Track.open(request.track)
    truth, convention = _truth(request, request.truth[0], track)
    markers = None if request.markers is None else load_markers(request.markers)
    try:
        if (
            request.convention is None
            and markers is None
            and request.truth[0].suffix.lower() == ".trc"
        ):
            truth, convention = _with_its_axes(track, truth, convention)
        evaluation = (
            evaluate(track, truth) if markers is None else evaluate_markers(track, markers, truth)
        )
    except InputError as error:
        raise InputError(f"{request.track} against {request.truth[0]}: {error}") from None
    by_index = request.truth_start is None and truth.at_rate(track.fps) is truth
    if by_index and (true_angles := _true_angles(request.truth[0])) is not None:
        angles = tuple(evaluate_angles(track, true_angles))
        evaluation = replace(evaluation, angles=angles)
    print_evaluation(evaluation)
    print_angles(evaluation.angles)
    if markers is None:
        better = axes_that_fit([(track, truth)], evaluation.mean_error, convention)
        if better is not None:
            warn(better, stdout)
    if track.smoothing is not None:
        shown = ", ".join(f"{k} {v}" for k, v in track.smoothing.items() if v is not None)
        stdout.print(f"the track was smoothed: {shown}", soft_wrap=True)
    folder = request.output or (request.track if request.track.is_dir() else request.track.parent)
    title = f"{resolve_path(request.track).name} against {request.truth[0].name}"
    with output_folder(folder, request.COMMAND, addition=True, replaces=True):
        written = _write_files(folder, evaluation, _select_files(request), title)
    stdout.print("wrote " + ", ".join(str(path) for path in written), soft_wrap=True)


def _run_people(request: EvaluateRequest) -> None:
    """Compare the tracks of several people."""
    request.refuse(["markers"], f"applies only to one person; expected {request.track / 'person1'}")
    tracks = PeopleTracks.open(request.track)
    truth, convention = _truth_of_people(request, tracks[0].fps)
    try:
        evaluation = evaluate_people(tracks, truth)
    except InputError as error:
        stated = " ".join(map(str, request.truth))
        raise InputError(f"{request.track} against {stated}: {error}") from None
    print_people_evaluation(evaluation)
    pairs = [(track, series) for series in truth.values() for track in tracks]
    better = axes_that_fit(pairs, evaluation.apart, convention)
    if better is not None:
        warn(better, stdout)
    folder, wanted, written = request.output or request.track, _select_files(request), []
    with output_folder(folder, request.COMMAND, addition=True, replaces=True):
        for name, number, errors in zip(
            evaluation.names, evaluation.tracks, evaluation.errors, strict=True
        ):
            if errors is not None:
                own = person_folder(folder, int(number) + 1)
                own.mkdir(parents=True, exist_ok=True)
                written += _write_files(own, errors, wanted, f"{own.name} against {name}")
        if "json" in wanted:
            written.append(folder / "evaluation.json")
            evaluation.write_json(written[-1])
    stdout.print("wrote " + ", ".join(str(path) for path in written), soft_wrap=True)


def _truth_of_people(request: EvaluateRequest, fps: float) -> tuple[dict[str, JointSeries], str]:
    """Return the truth of each person by name, in the frames of a sequence with `fps`, and the
    convention of its axes."""
    if len(request.truth) == 1 and request.truth[0].suffix.lower() == ".npz":
        truth = load_people_truth(request.truth[0])
        if request.truth_start is None:
            return truth, "z-up"
        start = request.truth_start
        return {name: of.resample(fps, start) for name, of in truth.items()}, "z-up"
    names = [path.stem for path in request.truth]
    if len(set(names)) < len(names):
        names = [str(path) for path in request.truth]
    read = [_truth_of_one(request, path, fps) for path in request.truth]
    truth = {name: series for name, (series, _) in zip(names, read, strict=True)}
    return truth, read[0][1]


def _truth(request: EvaluateRequest, path: Path, track: Track) -> tuple[JointSeries, str]:
    """Return the truth of a track in its frames, and the convention of its axes; of several people
    that of the nearest, which is printed."""
    if request.truth_start is not None or not is_of_people(path):
        return _truth_of_one(request, path, track.fps)
    request.refuse(["convention"], f"applies only to a TRC or C3D; {path} has Z up")
    truth, name = load_followed_truth(track, path)
    stdout.print(f"the truth is of several people; the nearest is {name}", soft_wrap=True)
    return truth, "z-up"


def _true_angles(path: Path) -> TrueAngles | None:
    """Return the true angles of one person; None if the file has none, or is of several."""
    return None if is_of_people(path) else load_true_angles(path)


def _select_files(request: EvaluateRequest) -> list[str]:
    """Return the kinds of files that the flags ask for, all without such flags."""
    chosen = {"csv": request.csv, "plot": request.plot, "json": request.json_file}
    return [kind for kind, on in chosen.items() if on] or list(chosen)


def _truth_of_one(request: EvaluateRequest, path: Path, fps: float) -> tuple[JointSeries, str]:
    """Return the truth in the frames of a sequence with `fps`, and the convention of its axes."""
    kind = path.suffix.lower()
    if kind == ".c3d":
        truth = read_c3d(path, request.convention)
        return truth.resample(fps, request.truth_start), request.convention or "z-up"
    if kind != ".trc":
        request.refuse(["convention"], f"applies only to a TRC or C3D; {path} has Z up")
    # An npz is in world axes.
    convention = (request.convention or "y-up") if kind == ".trc" else "z-up"
    truth = load_truth(path, convention)
    if request.truth_start is not None:
        truth = truth.resample(fps, request.truth_start)
    return truth, convention


def _with_its_axes(track: Track, truth: JointSeries, default: str) -> tuple[JointSeries, str]:
    """Return the truth of a TRC, read by the `default` convention, in the axes with which it is
    near the track, and their name; print which if they are others."""
    convention, found = choose_convention(track, truth, default)
    if convention != default:
        stdout.print(
            f"the truth is read with --convention {convention}: with {default}, the default, it is "
            "of another place",
            soft_wrap=True,
        )
    return found, convention


def _write_files(folder: Path, evaluation: Evaluation, wanted: list[str], title: str) -> list[Path]:
    """Write the `wanted` files into `folder` and return them."""
    written = []
    if "csv" in wanted:
        written.append(folder / "evaluation.csv")
        evaluation.write_csv(written[-1])
    if "plot" in wanted:
        written.append(folder / "evaluation.png")
        write_plot(written[-1], evaluation, title)
    if "json" in wanted:
        written.append(folder / "evaluation.json")
        evaluation.write_json(written[-1])
    return written


def print_evaluation(evaluation: Evaluation) -> None:
    """Print the table of joints and the overall figures to standard output."""
    summary = evaluation.summary()
    table = Table(title="Distance to the truth, mm", title_justify="left")
    table.add_column("joint")
    for column in ("mean", "median", "max", "constant", "rest", "in 95 %"):
        table.add_column(column, justify="right")
    keys = ("mean_mm", "median_mm", "max_mm", "constant_mm", "rest_mm")
    for row in summary["joints"]:
        figures = [_number(row[key]) for key in keys]
        table.add_row(row["joint"], *figures, _share(row["inside_95"]))
    table.add_section()
    keys = ("mean_error_mm", "median_error_mm", "max_error_mm", "constant_mm", "rest_mm")
    figures = [_number(summary[key]) for key in keys]
    table.add_row("all", *figures, _share(summary["inside_95"]), style="bold")
    stdout.print(table)
    lines = [
        f"mean error {summary['mean_error_mm']:.1f} mm over {summary['n_frames']} frames "
        f"and {summary['n_joints']} joints",
        "constant: median offset in the body's own frame (the joint sits elsewhere in the body); "
        "rest: the mean error without it; in 95 %: share of frames in which the truth lies inside "
        "the ellipsoid that the track states for 95 %",
        f"lost joints (beyond {1000 * LOST_JOINT:.0f} mm): {summary['lost_joint_share']:.1%}",
        f"lost limbs (end beyond {1000 * LOST_LIMB:.0f} mm for more than {LOST_FRAMES} frames "
        f"or at the end): {', '.join(summary['lost_limbs']) or 'none'}",
    ]
    if summary["limbs_said_to_be_lost"]:
        shares = ", ".join(f"{n} {s:.1%}" for n, s in summary["limbs_said_to_be_lost"].items())
        lines.append(
            f"frames in which the track reports a limb as lost: {shares}; of limbs beyond "
            f"{1000 * LOST_LIMB:.0f} mm {_share(summary['limbs_beyond_200_mm_flagged'])}, of those "
            f"within {1000 * LOST_JOINT:.0f} mm {_share(summary['limbs_within_150_mm_flagged'])}; "
            f"in 95 %, of joints without: {_share(summary['inside_95_unflagged'])}"
        )
    if summary["lost_frames"]:
        lost = spans(summary["lost_frames"])
        lines.append(f"frames in which the track reports the person as lost: {lost}")
    for side, names in summary["not_compared"].items():
        if names:
            lines.append(f"not compared, of the {side}: {', '.join(names)}")
    if evaluation.n_ignored:
        lines.append(f"ignored, because the truth is missing: {evaluation.n_ignored} joint-frames")
    for line in lines:
        stdout.print(line, soft_wrap=True)
    for warning in evaluation.warnings:
        warn(warning, stdout)


def print_people_evaluation(evaluation: PeopleEvaluation) -> None:
    """Print a row for each person, and how well people are counted and kept apart."""
    table = Table(title="Distance to the truth", title_justify="left")
    table.add_column("true person")
    table.add_column("track")
    for column in ("frames", "mean, mm", "median, mm", "beyond 150 mm", "in 95 %"):
        table.add_column(column, justify="right")
    summary = evaluation.summary()
    for person in summary["persons"]:
        errors, track = person["errors"], person["track"]
        frames = f"{person['matched_frames']} of {person['true_frames']}"
        figures = ["-"] * 4 if errors is None else [
            _number(errors["mean_error_mm"]), _number(errors["median_error_mm"]),
            f"{errors['lost_joint_share']:.1%}", _share(errors["inside_95"]),
        ]  # fmt: skip
        table.add_row(person["name"], f"person{track}" if track else "none", frames, *figures)
    stdout.print(table)
    switches = ", ".join(f"{name} in frame {frame}" for frame, name in evaluation.switches)
    lines = [
        f"as many people as there are in {evaluation.count_right:.1%} of {len(evaluation.frames)} "
        "frames",
        f"identity switches: {len(evaluation.switches)}{f' ({switches})' if switches else ''}; "
        f"missed person-frames: {evaluation.misses}; of nobody: {evaluation.false_positives}",
        f"MOTA {evaluation.mota:.1%}, IDF1 {evaluation.idf1:.1%}; a track is a person's where its "
        f"joints are within {1000 * MATCHED:.0f} mm on average",
    ]
    for line in lines:
        stdout.print(line, soft_wrap=True)
    for warning in evaluation.warnings:
        warn(warning, stdout)


def print_angles(errors: Sequence[AngleError]) -> None:
    """Print the errors of the joint angles to standard output, if there are any."""
    if not errors:
        return
    table = Table(title="Joint angles against the truth's, degrees", title_justify="left")
    table.add_column("angle")
    for column in ("RMS", "offset-free", "frames"):
        table.add_column(column, justify="right")
    for error in errors:
        figures = f"{error.rms:.1f}", f"{error.free:.1f}", str(error.n_frames)
        table.add_row(error.name, *figures, style=None if error.defined else "dim")
    table.add_section()
    rms, free = mean_error(errors)
    table.add_row("all", f"{rms:.1f}", f"{free:.1f}", "", style="bold")
    stdout.print(table)
    stdout.print(
        "offset-free: without the mean difference (the truth's rest pose is another); all: without "
        "the plane of elevation and axial rotation of arms, undefined where these hang",
        soft_wrap=True,
    )


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.0%}"
