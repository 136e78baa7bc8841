"""IoU per camera, as a table and as JSON has it: for `psfs check` and `psfs mesh --check`."""

from __future__ import annotations

import numpy as np
from rich.table import Table


def iou_table(title: str, names: list[str], scores: np.ma.MaskedArray) -> Table:
    """Return a table of mean and worst scores (frames, V): a row per camera, then one for all; a
    dash if there was nothing to compare."""
    table = Table("camera", title=title, title_justify="left")
    table.add_column("mean", justify="right")
    table.add_column("worst frame", justify="right")
    for name, column in zip(names, scores.T, strict=True):
        table.add_row(name, _cell(column.mean()), _cell(column.min()))
    table.add_section()
    table.add_row("all", _cell(scores.mean()), _cell(scores.min()))
    return table


def _cell(score: float) -> str:
    return "-" if np.ma.is_masked(score) else f"{score:.3f}"
