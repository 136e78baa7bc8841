"""`apf evaluate`: compare a track with the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from apf.evaluation.angle_truth import AngleError, evaluate_angles, mean_error
from apf.evaluation.conventions import axes_that_fit, choose_convention
from apf.evaluation.evaluate import LOST_FRAMES, LOST_JOINT, Evaluation, evaluate
from apf.evaluation.evaluation_plot import write_plot
from apf.evaluation.marker_truth import MarkerSet, evaluate_markers, load_markers
from apf.evaluation.people import MATCHED, PeopleEvaluation, evaluate_people, find_followed
from apf.evaluation.truth import load_people_truth, load_truth
from apf.formats.c3d import read_c3d
from apf.formats.trc import JointSeries
from apf.request import EvaluateRequest
from apf.tracking.limb_confidence import LOST_LIMB
from apf.tracking.people import PeopleTracks, holds_people, person_folder
from apf.tracking.track import Track, spans
from cl import InputError
from psfs.cli.commandline import make_table, stdout, warn
from psfs.common.files import name_file_in_errors, resolve_path
from psfs.common.outputs import output_folder


def run(request: EvaluateRequest) -> None:
    several = holds_people(request.track)
    if several:
        instead = f"applies only to one person; expected {request.track / 'person1'}"
        request.refuse(["markers"], instead)
    elif len(request.truth) > 1:
        raise InputError(
            f"{request.track}: the track of one person; expected one file of the truth, found "
            f"{len(request.truth)}"
        )
    tracks = PeopleTracks.open(request.track)
    markers = None if request.markers is None else load_markers(request.markers)
    truth, convention = _read_truth(request, tracks[0].fps)
    evaluation: Evaluation | PeopleEvaluation
    with name_file_in_errors(f"{request.track} against {' '.join(map(str, request.truth))}"):
        if several:
            evaluation = evaluate_people(tracks, truth)
            pairs = [(track, series) for series in truth.values() for track in tracks]
            better = axes_that_fit(pairs, evaluation.apart, convention)
        else:
            evaluation, better = _evaluate_one(request, tracks[0], truth, convention, markers)
    if isinstance(evaluation, Evaluation):
        print_evaluation(evaluation)
        print_angles(evaluation.angles)
    else:
        print_people_evaluation(evaluation)
    for warning in (*evaluation.warnings, *filter(None, (better,))):
        warn(warning, stdout)
    if not several and tracks[0].smoothing is not None:
        shown = ", ".join(f"{k} {v}" for k, v in tracks[0].smoothing.items() if v is not None)
        stdout.print(f"the track was smoothed: {shown}")
    folder = request.output or (request.track if request.track.is_dir() else request.track.parent)
    chosen = {"csv": request.csv, "plot": request.plot, "json": request.json_file}
    wanted = [kind for kind, on in chosen.items() if on] or list(chosen)
    with output_folder(folder, request.COMMAND, addition=True, replaces=True):
        if isinstance(evaluation, Evaluation):
            title = f"{resolve_path(request.track).name} against {request.truth[0].name}"
            written = _write_files(folder, evaluation, wanted, title)
        else:
            written = _write_people(folder, evaluation, wanted)
    stdout.print("wrote " + ", ".join(str(path) for path in written))


def _evaluate_one(
    request: EvaluateRequest,
    track: Track,
    truths: dict[str, JointSeries],
    convention: str,
    markers: MarkerSet | None,
) -> tuple[Evaluation, str | None]:
    """Compare a track with the nearest of the true people; return also a message if the truth has
    other axes or another unit."""
    path, name = request.truth[0], find_followed(track, truths)
    truth = truths[name]
    if len(truths) > 1:
        stdout.print(f"the truth is of several people; the nearest is {name}")
    if markers is not None:
        return evaluate_markers(track, markers, truth), None
    if request.convention is None and path.suffix.lower() == ".trc":
        default = convention
        convention, truth = choose_convention(track, truth, default)
        if convention != default:
            stdout.print(
                f"the truth is read with --convention {convention}: with {default}, the default, "
                "it is of another place"
            )
    evaluation = evaluate(track, truth)
    by_index = request.truth_start is None and truth.at_rate(track.fps) is truth
    if by_index:
        evaluation = replace(evaluation, angles=tuple(evaluate_angles(track, path)))
    return evaluation, axes_that_fit([(track, truth)], evaluation.mean_error, convention)


def _read_truth(request: EvaluateRequest, fps: float) -> tuple[dict[str, JointSeries], str]:
    """Return the truth of each person by name, in the frames of a sequence with `fps`, and the
    convention of its axes."""
    convention, truth = "", dict[str, JointSeries]()
    stems = [path.stem for path in request.truth]
    for path in request.truth:
        kind = path.suffix.lower()
        if kind not in (".trc", ".c3d"):
            request.refuse(["convention"], f"applies only to a TRC or C3D; {path} has Z up")
        convention = request.convention or ("y-up" if kind == ".trc" else "z-up")
        name = path.stem if stems.count(path.stem) == 1 else str(path)
        if kind == ".c3d":
            read = {name: read_c3d(path, request.convention)}
        elif len(request.truth) > 1:
            read = {name: load_truth(path, convention)}
        else:
            read = load_people_truth(path, convention)
        if kind == ".c3d" or request.truth_start is not None:
            start = request.truth_start
            read = {name: of.resample(fps, start) for name, of in read.items()}
        truth |= read
    return truth, convention


def _write_people(folder: Path, evaluation: PeopleEvaluation, wanted: list[str]) -> list[Path]:
    """Write the `wanted` files of each person into a folder of their own in `folder`, and the
    figures of all; return the files."""
    written = []
    for name, number, errors in zip(
        evaluation.names, evaluation.tracks, evaluation.errors, strict=True
    ):
        if errors is not None:
            subfolder = person_folder(folder, int(number) + 1)
            written += _write_files(subfolder, errors, wanted, f"{subfolder.name} against {name}")
    if "json" in wanted:
        written.append(folder / "evaluation.json")
        evaluation.write_json(written[-1])
    return written


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
    columns = "mean", "median", "max", "constant", "rest", "in 95 %"
    table = make_table("Distance to the truth, mm", ("joint",), columns)
    keys = ("mean_mm", "median_mm", "max_mm", "constant_mm", "rest_mm")
    for row in (*summary["joints"], *summary["toes"]):
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
        *["toes: their tips, which the row of all leaves out"] * bool(summary["toes"]),
        f"lost joints (beyond {1000 * LOST_JOINT:.0f} mm): {summary['lost_joint_share']:.1%}",
        f"lost limbs (end beyond {1000 * LOST_LIMB:.0f} mm for more than {LOST_FRAMES} frames "
        f"or at the end): {', '.join(summary['lost_limbs']) or 'none'}",
    ]
    if summary["limbs_said_to_be_lost"]:
        shares = ", ".join(f"{n} {s:.1%}" for n, s in summary["limbs_said_to_be_lost"].items())
        right = summary["limbs_beyond_200_mm_flagged"]
        limit = f"limbs with an error above {1000 * LOST_LIMB:.0f} mm"
        rightly = "" if right is None else f"{right:.0%} of {limit} and "
        lines.append(
            f"the track itself marks as lost, of all frames: {shares}. It marks {rightly}"
            f"{_share(summary['limbs_within_150_mm_flagged'])} of limbs below "
            f"{1000 * LOST_JOINT:.0f} mm; in 95 %, of all joints not marked: "
            f"{_share(summary['inside_95_unflagged'])}"
        )
    if summary["lost_frames"]:
        lost = spans(summary["lost_frames"])
        lines.append(f"the track itself marks the person as lost in frames {lost}")
    for side, names in summary["not_compared"].items():
        if names:
            lines.append(f"not compared, of the {side}: {', '.join(names)}")
    if evaluation.n_ignored:
        lines.append(f"ignored, because the truth is missing: {evaluation.n_ignored} joint-frames")
    stdout.print("\n".join(lines))


def print_people_evaluation(evaluation: PeopleEvaluation) -> None:
    """Print a row for each person, and how well people are counted and kept apart."""
    columns = "frames", "mean, mm", "median, mm", "beyond 150 mm", "in 95 %"
    table = make_table("Distance to the truth", ("true person", "track"), columns)
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
    stdout.print("\n".join(lines))


def print_angles(errors: Sequence[AngleError]) -> None:
    """Print the errors of the joint angles to standard output, if there are any."""
    if not errors:
        return
    title, columns = "Joint angles against the truth's, degrees", ("RMS", "offset-free", "frames")
    table = make_table(title, ("angle",), columns)
    for error in errors:
        figures = f"{error.rms:.1f}", f"{error.free:.1f}", str(error.n_frames)
        table.add_row(error.name, *figures, style=None if error.defined else "dim")
    table.add_section()
    rms, free = mean_error(errors)
    table.add_row("all", f"{rms:.1f}", f"{free:.1f}", "", style="bold")
    stdout.print(table)
    stdout.print(
        "offset-free: without the mean difference (the truth's rest pose is another); all: without "
        "the plane of elevation and axial rotation of arms, undefined where these hang"
    )


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.0%}"
