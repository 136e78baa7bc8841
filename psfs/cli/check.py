"""`psfs check OUT`: do the voxels agree with the silhouettes?"""

from __future__ import annotations

import argparse
from collections.abc import Collection
from pathlib import Path

import numpy as np

from cl import InputError, select_device
from psfs.cli.commandline import progress_bar, stdout, warn
from psfs.cli.iou import iou_table, plain
from psfs.common.files import write_json
from psfs.common.outputs import output_folder
from psfs.diagnostics.camera_consistency import (
    InconsistentCamera,
    find_inconsistent_cameras,
)
from psfs.diagnostics.definitions import DEFINITION
from psfs.diagnostics.examination import Examination
from psfs.diagnostics.faults import diagnose
from psfs.diagnostics.reprojection_iou import Checker, describe_cut_silhouettes
from psfs.output.reconstruction_folder import ReconstructionFolder
from psfs.session import Session, SessionSettings

#: IoU below which a camera's agreement is reported as low.
_LOW = 0.6


def run(args: argparse.Namespace) -> None:
    run = ReconstructionFolder.open(args.out)
    if not run.indices:
        raise InputError(f"{args.out}: holds no reconstructed frame; expected at least one")
    run.warn_if_unfinished(warn)
    sequence = run.sequence()
    device = select_device(args.device)
    session = Session(sequence, device, SessionSettings(run.config))
    checker = Checker(session, run.grid)
    scores = []
    first, last = run.indices[0], run.indices[-1]
    step = run.indices[1] - first if len(run.indices) > 1 else 1
    frames = sequence.frames(slice(first, last + 1, step))
    with progress_bar() as bar:
        for frame in bar.track(frames, len(run.indices), description="checking"):
            scores.append(checker(frame, run.cloud(frame.index)))
    diagnosis = diagnose(session)
    bad = find_inconsistent_cameras(session, diagnosis.reasons)
    names, found = sequence.rig.names, np.array(scores)
    comments = Examination(session, diagnosis, tuple(bad)).warnings[len(bad) :]
    cut = describe_cut_silhouettes(names, np.array(checker.beyond))
    comments += [cut] if cut else []
    named = {suspect.camera for suspect in bad} | set(diagnosis.reasons)
    if not comments:
        comments = low_agreement(names, found, named)
    with output_folder(args.out, args.parser.prog, addition=True):
        _report(args.out, run, names, found, bad, comments)


def low_agreement(names: list[str], scores: np.ndarray, named: Collection[str]) -> list[str]:
    """Return texts that name the cameras with low scores (frames, V), except those `named`
    already."""
    means = np.ma.masked_invalid(scores).mean(axis=0).filled(np.nan)
    low = [n for n, mean in zip(names, means, strict=True) if mean < _LOW and n not in named]
    return [
        f"camera {name}: its silhouettes and the voxels agree little; they lack parts of the "
        "person, or hold what the others do not see; look: psfs silhouettes FOLDER -o SIL"
        for name in low
    ]


def _report(
    out: Path,
    run: ReconstructionFolder,
    names: list[str],
    scores: np.ndarray,
    bad: list[InconsistentCamera],
    comments: list[str],
) -> None:
    """Print and write scores (frames, V): IoU, NaN if there was nothing to compare."""
    masked = np.ma.masked_invalid(scores)
    stdout.print(iou_table("IoU with the frames' silhouettes", names, masked))
    left_out: dict[str, str] = run.summary["sequence"].get("left_out", {})
    disagreeing = left_out | {suspect.camera: str(suspect) for suspect in bad}
    for text in (*disagreeing.values(), *comments):
        warn(text, stdout)
    report = {
        "definition": DEFINITION,
        "mean_iou": plain(masked.mean()),
        "cameras": {
            name: {"mean_iou": plain(column.mean()), "worst_iou": plain(column.min())}
            for name, column in zip(names, masked.T, strict=True)
        },
        "disagreeing": disagreeing,
        "comments": comments,
        "frames": {
            str(index): [plain(score) for score in row]
            for index, row in zip(run.indices, scores, strict=True)
        },
    }
    write_json(out / "check.json", report)
