"""Tables of `compare_timings.py people`."""

from __future__ import annotations

from typing import Any

from timings.results import Results
from timings.tables.grid import Grid, number


def print_report(results: Results) -> None:
    for grid in make_tables(results):
        grid.show()


def make_tables(results: Results) -> list[Grid]:
    """Return a table for each device: ms from poses to poses by the number of people."""
    devices: dict[str, list[Any]] = {}
    for section in results.sections.values():
        devices.setdefault(section["label"], []).append(section)
    return [_table(label, rows) for label, rows in devices.items()]


def _table(label: str, rows: list[Any]) -> Grid:
    first = rows[0]
    cells = []
    for row in rows:
        ms = min(run.median for run in row["runs"])
        further = row["people"] - first["people"]
        each = (ms - min(run.median for run in first["runs"])) / further if further else 0.0
        errors = ", ".join(f"{error:.1f}" for error in row["errors_mm"])
        runs = ", ".join(str(run) for run in row["runs"])
        cells.append([str(row["people"]), runs, number(each) if further else "", errors])
    return Grid(
        f"A streamed frame, {label}",
        ["people", "ms of each run", "ms for each further one", "errors, mm"],
        cells,
    )
