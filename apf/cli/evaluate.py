"""`apf evaluate`: a track against the truth."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.table import Table

from apf.formats.trc import CONVENTIONS
from apf.results.conventions import axes_that_fit
from apf.results.evaluate import (
    LOST_FRAMES,
    LOST_JOINT,
    LOST_LIMB,
    Evaluation,
    evaluate,
    load_truth,
)
from apf.results.evaluation_plot import write_plot
from apf.tracking.track import Track, spans
from cl import InputError
from psfs.cli.commandline import add_command, stdout, warn
from psfs.common.files import full_path
from psfs.common.outputs import output_folder

_FILES = {"csv": "errors per frame", "plot": "a picture (PNG)", "json": "all figures"}


def register(commands: argparse._SubParsersAction) -> None:
    parser = add_command(
        commands, "evaluate", run, "Compare a track with the truth, joint by joint."
    )
    parser.add_argument("track", type=Path, metavar="OUT", help="folder of `apf track`, or its npz")
    parser.add_argument("--truth", type=Path, required=True, metavar="FILE", help="npz or TRC")
    parser.add_argument(
        "--convention",
        choices=CONVENTIONS,
        default="y-up",
        help="axes of a TRC: y-up (X Y Z) = world (x z -y), as `apf track` writes it; "
        "pose2sim = world (y z x); z-up = world (x y z) (default: y-up)",
    )
    for kind, what in _FILES.items():
        parser.add_argument(f"--{kind}", action="store_true", help=f"write {what}")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FOLDER",
        help="where evaluation.csv, .png and .json go (default: beside the track); "
        "all three unless some of --csv, --plot, --json choose",
    )


def run(args: argparse.Namespace) -> None:
    track = Track.open(args.track)
    truth = load_truth(args.truth, args.convention)
    # An npz has the world's own axes.
    convention = args.convention if args.truth.suffix.lower() == ".trc" else "z-up"
    try:
        evaluation = evaluate(track, truth)
    except InputError as error:
        raise InputError(f"{args.track} against {args.truth}: {error}") from None
    print_evaluation(evaluation)
    better = axes_that_fit(track, truth, evaluation, convention)
    if better is not None:
        warn(better, stdout)
    if track.smoothing is not None:
        shown = ", ".join(f"{k} {v}" for k, v in track.smoothing.items() if v is not None)
        stdout.print(f"the track was smoothed: {shown}", soft_wrap=True)
    folder = args.output or (args.track if args.track.is_dir() else args.track.parent)
    wanted = [kind for kind in _FILES if getattr(args, kind)] or list(_FILES)
    with output_folder(folder, args.parser.prog, addition=True, replaces=True):
        written = _written(args, folder, evaluation, wanted)
    stdout.print("wrote " + ", ".join(str(path) for path in written), soft_wrap=True)


def _written(
    args: argparse.Namespace, folder: Path, evaluation: Evaluation, wanted: list[str]
) -> list[Path]:
    """Write the `wanted` files into `folder` and return them."""
    written = []
    if "csv" in wanted:
        written.append(folder / "evaluation.csv")
        evaluation.write_csv(written[-1])
    if "plot" in wanted:
        written.append(folder / "evaluation.png")
        title = f"{full_path(args.track).name} against {args.truth.name}"
        write_plot(written[-1], evaluation, title)
    if "json" in wanted:
        written.append(folder / "evaluation.json")
        evaluation.write_json(written[-1])
    return written


def print_evaluation(evaluation: Evaluation) -> None:
    """The table of joints and the figures of the whole, on standard output."""
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
    if summary["lost_frames"]:
        lost = spans(summary["lost_frames"])
        lines.append(f"frames in which the track says to have lost the person: {lost}")
    for side, names in summary["not_compared"].items():
        if names:
            lines.append(f"not compared, of the {side}: {', '.join(names)}")
    if evaluation.n_ignored:
        lines.append(f"ignored for want of truth: {evaluation.n_ignored} joint-frames")
    for line in lines:
        stdout.print(line, soft_wrap=True)
    for warning in evaluation.warnings:
        warn(warning, stdout)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.0%}"
