"""`psfs check OUT`: do the voxels agree with the silhouettes?"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from rich.markup import escape
from rich.table import Table

from cl import UserError, select_device
from psfs.agreement import Suspect, suspects
from psfs.check import DEFINITION, Checker
from psfs.commandline import add_command, add_device_flag, progress_bar, stdout
from psfs.runs import Run, write_json


def register(commands: argparse._SubParsersAction) -> None:
    help = "compare reprojected clouds with the silhouettes of their frames"
    parser = add_command(commands, "check", _run, help=help)
    parser.description = f"{help}. {DEFINITION}. Writes OUT/check.json."
    parser.add_argument("out", metavar="OUT", type=Path, help="output folder of psfs reconstruct")
    add_device_flag(parser)


def _run(args: argparse.Namespace) -> None:
    run = Run.open(args.out)
    if not run.indices:
        raise UserError(f"{args.out}: holds no reconstructed frame; expected at least one")
    sequence = run.sequence()
    device = select_device(args.device)
    checker = Checker(device, sequence, run)
    scores = []
    first, last = run.indices[0], run.indices[-1]
    step = run.indices[1] - first if len(run.indices) > 1 else 1
    frames = sequence.frames(slice(first, last + 1, step))
    with progress_bar() as bar:
        for frame in bar.track(frames, len(run.indices), description="checking"):
            scores.append(checker(frame, run.cloud(frame.index)))
    bad = suspects(sequence, run.config.silhouette, device)
    _report(args.out, run, sequence.rig.names, np.array(scores), bad)


def _report(out: Path, run: Run, names: list[str], scores: np.ndarray, bad: list[Suspect]) -> None:
    """scores: (frames, V) IoU, NaN where there was nothing to compare."""
    masked = np.ma.masked_invalid(scores)
    means = masked.mean(0).filled(0.0)
    worst = masked.min(0).filled(0.0)
    overall = float(masked.mean()) if masked.count() else 0.0
    table = Table("camera", title="IoU with the frames' silhouettes", title_justify="left")
    table.add_column("mean", justify="right")
    table.add_column("worst frame", justify="right")
    for name, mean, low in zip(names, means, worst, strict=True):
        table.add_row(escape(name), f"{mean:.3f}", f"{low:.3f}")
    table.add_section()
    table.add_row("all", f"{overall:.3f}", f"{worst.min():.3f}")
    stdout.print(table)
    left_out: dict[str, str] = run.summary["sequence"].get("left_out", {})
    disagreeing = left_out | {suspect.camera: str(suspect) for suspect in bad}
    for reason in disagreeing.values():
        stdout.print(f"[yellow]warning:[/] {escape(reason)}", soft_wrap=True)
    report = {
        "definition": DEFINITION,
        "mean_iou": overall,
        "cameras": {
            name: {"mean_iou": float(mean), "worst_iou": float(low)}
            for name, mean, low in zip(names, means, worst, strict=True)
        },
        "disagreeing": disagreeing,
        "frames": {
            str(index): [None if np.isnan(score) else round(float(score), 5) for score in row]
            for index, row in zip(run.indices, scores, strict=True)
        },
    }
    write_json(out / "check.json", report)
