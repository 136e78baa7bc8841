"""`psfs check OUT`: do the voxels agree with the silhouettes?"""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.table import Table

from cl import InputError, select_device
from psfs.cli.commandline import make_table, progress_bar, stdout, warn
from psfs.common.files import write_json
from psfs.common.numbers import json_number, known_means
from psfs.common.outputs import output_folder
from psfs.diagnostics.config import DEFINITION
from psfs.diagnostics.examination import Examination, diagnose
from psfs.diagnostics.fault import Fault
from psfs.diagnostics.mask_scores import (
    CLOUD_DEFINITION,
    CloudScore,
    mean_scores,
    score_cloud,
    true_masks,
)
from psfs.diagnostics.reprojection_iou import Checker, describe_cut_silhouettes
from psfs.output.reconstruction_folder import ReconstructionFolder
from psfs.request import CheckRequest
from psfs.session import Session, SessionSettings

_REPORT = "check.json"
#: IoU below which a camera's agreement is reported as low.
_LOW = 0.6


def run(request: CheckRequest) -> None:
    with output_folder(request.out, request.COMMAND, expected=(_REPORT,), addition=True):
        _check(request)


def _check(request: CheckRequest) -> None:
    run = ReconstructionFolder.open(request.out)
    if not run.indices:
        raise InputError(f"{request.out}: holds no reconstructed frame; expected at least one")
    run.warn_if_unfinished(warn)
    sequence = run.sequence()
    device = select_device(request.device)
    session = Session(sequence, device, SessionSettings(run.config))
    checker = Checker(session, run.grid)
    scores, clouds = [], []
    first, last = run.indices[0], run.indices[-1]
    step = run.indices[1] - first if len(run.indices) > 1 else 1
    frames = sequence.frames(slice(first, last + 1, step))
    with progress_bar() as bar:
        for frame in bar.track(frames, len(run.indices), description="checking"):
            cloud = run.cloud(frame.index)
            scores.append(checker(frame, cloud))
            truth = true_masks(sequence, frame.index)
            if any(mask is not None for mask in truth):
                clouds.append(score_cloud(sequence.rig, cloud, truth))
    diagnosis = diagnose(session)
    bad = [fault for fault in diagnosis.faults if fault.spoils]
    names, found = sequence.rig.names, np.array(scores)
    comments = Examination(session, diagnosis, tuple(bad)).remaining
    cut = describe_cut_silhouettes(names, np.array(checker.beyond))
    comments += [cut] if cut else []
    named = {name for fault in diagnosis.faults if fault.serious for name in fault.cameras}
    if not comments:
        low = [n for n, mean in zip(names, known_means(found), strict=True) if mean < _LOW]
        comments = [
            f"camera {name}: its silhouettes and the voxels agree little; they lack parts of the "
            "person, or hold what the others do not see; look: "
            f"psfs silhouettes {sequence.folder} -o silhouettes"
            for name in low
            if name not in named
        ]
    _report(run, names, found, bad, comments, clouds)


def _report(
    run: ReconstructionFolder,
    names: list[str],
    scores: np.ndarray,
    bad: list[Fault],
    comments: list[str],
    clouds: list[CloudScore],
) -> None:
    """Print and write scores (frames, V): IoU, NaN if there was nothing to compare; and those of
    clouds with true masks."""
    masked = np.ma.masked_invalid(scores)
    stdout.print(iou_table("IoU with the frames' silhouettes", names, masked))
    if clouds:
        means = mean_scores(clouds)
        mean = {name: "-" if of is None else f"{of:.3f}" for name, of in means.items()}
        stdout.print(
            f"true masks of {len(clouds)} frames: IoU {mean['iou']}, with true silhouettes "
            f"{mean['ceiling']}; share of ghosts {mean['ghosts']}; IoU of voxels {mean['volume']}"
        )
    left_out: dict[str, str] = run.summary["sequence"].get("left_out", {})
    disagreeing = left_out | {fault.cameras[0]: str(fault) for fault in bad}
    for text in (*disagreeing.values(), *comments):
        warn(text, stdout)
    report: dict[str, Any] = {
        "definition": DEFINITION,
        "mean_iou": json_number(masked.mean()),
        "cameras": {
            name: {"mean_iou": json_number(column.mean()), "worst_iou": json_number(column.min())}
            for name, column in zip(names, masked.T, strict=True)
        },
        "disagreeing": disagreeing,
        "comments": comments,
        "frames": {
            str(index): [json_number(score) for score in row]
            for index, row in zip(run.indices, scores, strict=True)
        },
    }
    if clouds:
        report["truth"] = {"definition": CLOUD_DEFINITION, "frames": len(clouds)}
        report["truth"] |= mean_scores(clouds)
    write_json(run.out / _REPORT, report)


def iou_table(title: str, names: list[str], scores: np.ma.MaskedArray) -> Table:
    """Return a table of mean and worst scores (frames, V): a row per camera, then one for all; a
    dash if there was nothing to compare."""
    table = make_table(title, ["camera"], ["mean", "worst frame"])
    for name, column in zip(names, scores.T, strict=True):
        table.add_row(name, _cell(column.mean()), _cell(column.min()))
    table.add_section()
    table.add_row("all", _cell(scores.mean()), _cell(scores.min()))
    return table


def _cell(score: float) -> str:
    return "-" if np.ma.is_masked(score) else f"{score:.3f}"
