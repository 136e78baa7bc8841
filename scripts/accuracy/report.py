"""Tables and plot of the results of `accuracy.py`."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from timings.tables.grid import NONE, Grid

from accuracy.runs import Results, Run
from accuracy.settings import DIMENSIONS, Setting, Table
from psfs.common.files import write_atomically, write_text

#: Markers of the rows of a sequence.
_MARKS = "osv^Dx"
_LOST = "lost: runs in which a limb's end was lost, as `apf evaluate` says."
_CONSTANT = "constant: the offset that a joint keeps in the body's own frame; rest: without"


@dataclass(frozen=True)
class Summary:
    """Mean and standard deviation of the mean errors, mm, over the seeds of a setting."""

    mean: float
    std: float
    constant: float
    rest: float
    lost: int
    runs: int

    @classmethod
    def create(cls, runs: list[Run]) -> Summary | None:
        if not runs:
            return None
        means = np.array([run.mean for run in runs])
        return cls(
            float(means.mean()),
            float(means.std(ddof=1)) if len(runs) > 1 else 0.0,
            float(np.mean([run.constant for run in runs])),
            float(np.mean([run.rest for run in runs])),
            sum(run.lost for run in runs),
            len(runs),
        )

    def __str__(self) -> str:
        lost = f", {self.lost} lost" if self.lost else ""
        return f"{self.mean:.1f} ± {self.std:.1f}{lost}"


def grids(tables: dict[Table, list[Setting]], results: Results) -> list[Grid]:
    """Return a grid per table, with its last dimension in columns; settings without runs are left
    blank."""
    return [_grid(table, settings, results) for table, settings in tables.items()]


def _grid(table: Table, settings: list[Setting], results: Results) -> Grid:
    *heads, across = (DIMENSIONS[name] for name in table.dimensions)
    columns = table.columns(settings)
    cells: dict[tuple[Any, ...], dict[Any, str]] = {row: {} for row in table.rows(settings)}
    for setting in settings:
        summary = Summary.create(results.select(setting))
        cells[table.row_key(setting)][table.column_key(setting)] = str(summary) if summary else NONE
    rows = [[*map(str, row), *(of.get(c, NONE) for c in columns)] for row, of in cells.items()]
    shown = [f"{across}: {c}" if isinstance(c, int) else str(c) for c in columns]
    return Grid(f"Mean error, mm, by {table.title}", ["sequence", *heads, *shown], rows, _LOST)


def joints(setting: Setting, runs: list[Run]) -> Grid:
    """Return for each joint the mean error over all seeds, its constant part, and the rest."""
    rows = [
        [name, *(f"{np.mean([run.joints[name][k] for run in runs]):.1f}" for k in range(3))]
        for name in runs[0].joints
    ]
    summary = Summary.create(runs)
    assert summary is not None
    rows.append(["all", *(f"{of:.1f}" for of in (summary.mean, summary.constant, summary.rest))])
    title = (
        f"Joints of {setting.sequence}, {setting.cameras} cameras, {setting.method}, "
        f"{setting.particles} x {setting.layers}, mm"
    )
    return Grid(title, ["joint", "mean", "constant", "rest"], rows, _CONSTANT)


def made_on(results: Results) -> str:
    """Return a line with sequences, seeds, device, day and commit of results."""
    names = sorted({run.setting.sequence for run in results.runs})
    return (
        f"{', '.join(names)}; up to {len({run.seed for run in results.runs})} seeds, from the true "
        f"first pose; {results.conditions['device']}, {results.made}, commit "
        f"{results.conditions['commit'] or 'unknown'}"
    )


def headline(tables: dict[Table, list[Setting]], results: Results) -> str:
    """Return Markdown for the README: the first table."""
    first = grids(tables, results)[0]
    return replace(first, note=f"{made_on(results)}. {first.note}").markdown()


def write_tables(path: Path, parts: Sequence[Grid], results: Results) -> None:
    """Write Markdown: the conditions of the runs, and every grid."""
    about = f"{made_on(results)}. mm, mean ± standard deviation of the runs' means."
    texts = ["# Errors of tracking", about, *(grid.markdown() for grid in parts)]
    write_text(path, "\n\n".join(texts) + "\n")


def write_summary(path: Path, tables: dict[Table, list[Setting]], results: Results) -> None:
    """Write CSV: one row per table and setting, errors in mm."""
    with write_atomically(path) as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file)
        figures = ("mean_mm", "std_mm", "constant_mm", "rest_mm", "lost_runs", "runs")
        writer.writerow(["table", "sequence", *DIMENSIONS, *figures])
        for table, settings in tables.items():
            for setting in settings:
                summary = Summary.create(results.select(setting))
                if summary is None:
                    continue
                values = [getattr(setting, name) for name in DIMENSIONS]
                numbers = (summary.mean, summary.std, summary.constant, summary.rest)
                rounded = [f"{number:.2f}" for number in numbers]
                row = [table.name, setting.sequence, *values, *rounded, summary.lost, summary.runs]
                writer.writerow(row)


def plot(path: Path, tables: dict[Table, list[Setting]], results: Results) -> None:
    """Write a PNG: a panel per table, a line per row, the seeds' deviation as bars."""
    figure, panels = plt.subplots(
        1, len(tables), figsize=(5.2 * len(tables), 4.2), squeeze=False, layout="constrained"
    )
    for axes, (table, settings) in zip(panels[0], tables.items(), strict=True):
        _panel(axes, table, settings, results)
    with write_atomically(path) as temporary:
        figure.savefig(temporary, dpi=130)
    plt.close(figure)


def _panel(axes: Any, table: Table, settings: list[Setting], results: Results) -> None:
    """Draw a panel. All rows of a sequence have its colour, and differ by their markers."""
    columns = table.columns(settings)
    rows = table.rows(settings)
    sequences = list(dict.fromkeys(row[0] for row in rows))
    others = list(dict.fromkeys(row[1:] for row in rows))
    for number, row in enumerate(rows):
        points = [
            (columns.index(table.column_key(s)), summary)
            for s in settings
            if table.row_key(s) == row and (summary := Summary.create(results.select(s)))
        ]
        points.sort(key=lambda point: point[0])
        if not points:
            continue
        nth = sequences.index(row[0])
        colour = f"C{nth % 10}"
        shift = 0.3 * ((number + 0.5) / len(rows) - 0.5)
        places = [place + shift for place, _ in points]
        means, stds = [p.mean for _, p in points], [p.std for _, p in points]
        axes.errorbar(
            places, means, stds, marker=_MARKS[others.index(row[1:]) % len(_MARKS)], ms=4,
            capsize=3, lw=1.2, color=colour,
            label=", ".join(str(value) for value in row),
        )  # fmt: skip
        for place, summary in zip(places, (p for _, p in points), strict=True):
            if summary.lost:
                axes.annotate(
                    f"{summary.lost} lost", (place, summary.mean), fontsize=8, color=colour,
                    textcoords="offset points", xytext=(5, 14 - 9 * nth),
                )  # fmt: skip
    axes.set_xticks(range(len(columns)), [str(column).replace("+", "+\n") for column in columns])
    axes.set_xlabel(DIMENSIONS[table.dimensions[-1]])
    axes.set_ylabel("mean error, mm")
    axes.set_ylim(bottom=0)
    axes.grid(axis="y", color="#DDDDDD", lw=0.6)
    axes.set_title(f"by {table.title}", loc="left", fontsize=10)
    axes.legend(fontsize=8, frameon=False, ncols=1 + (len(rows) > 5))
