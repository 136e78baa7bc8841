"""Tables and plot of what `accuracy.py` found."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from rich.table import Table as RichTable

from accuracy.runs import Results, Run
from accuracy.settings import DIMENSIONS, Setting, Table
from psfs.commandline import stdout
from psfs.files import written_whole


@dataclass(frozen=True)
class Summary:
    """Over the seeds of a setting: mean and standard deviation of their mean errors, mm."""

    mean: float
    std: float
    constant: float
    rest: float
    lost: int
    runs: int

    @classmethod
    def of(cls, runs: list[Run]) -> Summary | None:
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


def print_tables(tables: dict[Table, list[Setting]], results: Results, seeds: int) -> None:
    """A table per dimension varied, last dimension in columns."""
    for table, settings in tables.items():
        columns = table.columns(settings)
        by_place = {(table.row_of(s), table.column_of(s)): s for s in settings}
        title = f"Mean error, mm ± deviation over up to {seeds} seeds, by {table.title}"
        shown = RichTable(title=title, title_justify="left")
        for heading in ("sequence", *(DIMENSIONS[name] for name in table.dimensions[:-1])):
            shown.add_column(heading)
        for column in columns:
            shown.add_column(f"{column}", justify="right")
        for row in table.rows(settings):
            cells = []
            for column in columns:
                setting = by_place.get((row, column))
                summary = Summary.of(results.of(setting)) if setting else None
                cells.append(str(summary) if summary else "-")
            shown.add_row(*map(str, row), *cells)
        stdout.print(shown)
    stdout.print("lost: runs in which the end of a limb was lost, as `apf evaluate` says")


def print_joints(setting: Setting, runs: list[Run]) -> None:
    """Per joint the mean error over all seeds, the part that is constant, and the rest."""
    if not runs:
        return
    title = f"Joints of {setting.sequence}, {setting.cameras} cameras, {setting.method}, mm"
    table = RichTable(title=title, title_justify="left")
    table.add_column("joint")
    for heading in ("mean", "constant", "rest"):
        table.add_column(heading, justify="right")
    for name in runs[0].joints:
        values = np.mean([run.joints[name] for run in runs], axis=0)
        table.add_row(name, *(f"{value:.1f}" for value in values))
    summary = Summary.of(runs)
    assert summary is not None
    table.add_section()
    shown = (summary.mean, summary.constant, summary.rest)
    table.add_row("all", *(f"{value:.1f}" for value in shown), style="bold")
    stdout.print(table)
    stdout.print("constant: the offset that a joint keeps in the body's own frame; rest: without")


def write_summary(path: Path, tables: dict[Table, list[Setting]], results: Results) -> None:
    """CSV: one row per table and setting, errors in mm."""
    with written_whole(path) as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file)
        figures = ("mean_mm", "std_mm", "constant_mm", "rest_mm", "lost_runs", "runs")
        writer.writerow(["table", "sequence", *DIMENSIONS, *figures])
        for table, settings in tables.items():
            for setting in settings:
                summary = Summary.of(results.of(setting))
                if summary is None:
                    continue
                values = [getattr(setting, name) for name in DIMENSIONS]
                numbers = (summary.mean, summary.std, summary.constant, summary.rest)
                rounded = [f"{number:.2f}" for number in numbers]
                row = [table.name, setting.sequence, *values, *rounded, summary.lost, summary.runs]
                writer.writerow(row)


def plot(path: Path, tables: dict[Table, list[Setting]], results: Results) -> None:
    """PNG: a panel per table, a line per row, the seeds' deviation as bars."""
    figure, panels = plt.subplots(
        1, len(tables), figsize=(5.2 * len(tables), 4.2), squeeze=False, layout="constrained"
    )
    for axes, (table, settings) in zip(panels[0], tables.items(), strict=True):
        _panel(axes, table, settings, results)
    with written_whole(path) as temporary:
        figure.savefig(temporary, dpi=130)
    plt.close(figure)


def _panel(axes: Any, table: Table, settings: list[Setting], results: Results) -> None:
    columns = table.columns(settings)
    rows = table.rows(settings)
    for number, row in enumerate(rows):
        points = [
            (columns.index(table.column_of(s)), summary)
            for s in settings
            if table.row_of(s) == row and (summary := Summary.of(results.of(s)))
        ]
        points.sort(key=lambda point: point[0])
        if not points:
            continue
        shift = 0.3 * ((number + 0.5) / len(rows) - 0.5)
        places = [place + shift for place, _ in points]
        means, stds = [p.mean for _, p in points], [p.std for _, p in points]
        label = ", ".join(str(value) for value in row)
        axes.errorbar(places, means, stds, marker="o", ms=4, capsize=3, lw=1.2, label=label)
        for place, summary in zip(places, (p for _, p in points), strict=True):
            if summary.lost:
                axes.annotate(
                    f"{summary.lost} lost", (place, summary.mean), xytext=(5, 5),
                    textcoords="offset points", fontsize=8, color="#B22222",
                )  # fmt: skip
    axes.set_xticks(range(len(columns)), [str(column) for column in columns])
    axes.set_xlabel(DIMENSIONS[table.dimensions[-1]])
    axes.set_ylabel("mean error, mm")
    axes.set_ylim(bottom=0)
    axes.grid(axis="y", color="#DDDDDD", lw=0.6)
    axes.set_title(f"by {table.title}", loc="left", fontsize=10)
    axes.legend(fontsize=8, frameon=False)
