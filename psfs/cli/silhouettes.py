"""`psfs silhouettes FOLDER -o OUT`: the silhouettes as pictures, beside true ones if there are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from rich.table import Table

from cl import select_device
from psfs.cli.commandline import make_table, progress_bar, stdout, warn
from psfs.common.files import write_json, write_picture
from psfs.common.numbers import json_number, pick_evenly
from psfs.common.outputs import OutputFolder, output_folder
from psfs.common.requests import SETTINGS, write_settings
from psfs.diagnostics.examination import synchronise
from psfs.diagnostics.mask_scores import (
    DEFINITION,
    TRUE_MASKS,
    draw_mosaic,
    score_silhouettes,
    truth_frames,
)
from psfs.opening import open_sequence, select_common_frames
from psfs.request import SHOWN, SilhouettesRequest
from psfs.request import SILHOUETTES as REPORT
from psfs.sequence import Sequence
from psfs.session import Session, SessionSettings

_FIGURES = ("iou", "missed", "extra", "foreground")


def run(request: SilhouettesRequest) -> None:
    out: Path = request.output
    expected = (REPORT, SETTINGS, f"frame_{6 * '[0-9]'}.png")
    with output_folder(out, request.COMMAND, [Path(request.folder)], expected) as opened:
        _show(request, opened)


def _show(request: SilhouettesRequest, opened: OutputFolder) -> None:
    out: Path = request.output
    device = select_device(request.device)
    settings = SessionSettings(request.reconstruction)
    session = synchronise(Session(open_sequence(request), device, settings))
    sequence = session.sequence
    opened.check_inputs([*sequence.inputs, sequence.folder / TRUE_MASKS])
    wanted = sorted(select_common_frames(request.frames, sequence, warn))
    if request.frames is None:
        wanted = truth_frames(sequence) or pick_evenly(len(sequence), SHOWN).tolist()
    scores: dict[int, np.ndarray] = {}  # (V, 4) of each frame that was shown
    try:
        with progress_bar() as bar:
            shown = score_silhouettes(session, wanted)
            for found in bar.track(shown, max(wanted) + 1, description="reconstructing"):
                if found is None:
                    continue
                index = found.frame.index
                write_picture(out / f"frame_{index:06d}.png", draw_mosaic(sequence.rig, found))
                scores[index] = found.scores
    finally:  # write what is finished, also after an interruption
        if scores:
            stack = np.ma.masked_invalid(np.stack(list(scores.values())))
            write_json(out / REPORT, _report(sequence, scores, stack))
            write_settings(out, request, ["reconstruction"])
            stdout.print(_table(sequence.rig.names, stack))
            stdout.print(f"wrote {out}")


def _report(
    sequence: Sequence, scores: Mapping[int, np.ndarray], stack: np.ma.MaskedArray
) -> dict[str, object]:
    """Return all figures for JSON; stack: the scores (frames, V, 4), masked without truth."""
    means, worst = stack.mean(axis=0), stack[..., 0].min(axis=0)
    return {
        "definition": DEFINITION,
        "sequence": str(sequence.folder),
        "mean_iou": json_number(stack[..., 0].mean()),
        "cameras": {
            name: {f"mean_{key}": json_number(v) for key, v in zip(_FIGURES, mean, strict=True)}
            | {"worst_iou": json_number(low)}
            for name, mean, low in zip(sequence.rig.names, means, worst, strict=True)
        },
        "frames": {
            str(index): {key: list(map(json_number, of[:, k])) for k, key in enumerate(_FIGURES)}
            for index, of in scores.items()
        },
    }


def _table(names: list[str], stack: np.ma.MaskedArray) -> Table:
    """Return a table of the cameras' means over the frames, with IoU if there are true masks."""
    known = not np.ma.is_masked(stack[..., 0].mean())
    titles = ("mean IoU", "worst frame", "missed", "too much") if known else ()
    columns = (*titles, "share of the picture")
    table = make_table(f"Silhouettes in {len(stack)} frames", ["camera"], columns)
    for name, of in zip(names, np.ma.swapaxes(stack, 0, 1), strict=True):
        table.add_row(name, *_cells(of, known))
    table.add_section()
    table.add_row("all", *_cells(stack.reshape(-1, len(_FIGURES)), known))
    return table


def _cells(scores: np.ma.MaskedArray, known: bool) -> list[str]:
    """Return the cells of scores (N, 4): means, and the worst IoU."""
    mean, missed, extra, foreground = scores.mean(axis=0)
    if not known:
        return [f"{foreground:.1%}"]
    if np.ma.is_masked(mean):
        return ["-", "-", "-", "-", f"{foreground:.1%}"]
    worst = scores[:, 0].min()
    return [f"{mean:.3f}", f"{worst:.3f}", f"{missed:.1%}", f"{extra:.1%}", f"{foreground:.1%}"]
