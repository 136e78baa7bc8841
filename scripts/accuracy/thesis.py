"""Counterparts of the error tables in Rymut's thesis, beside the thesis's own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from timings.report.readme import replace_marked
from timings.tables.grid import NONE, Grid, quote
from timings.tables.whole import papers

from accuracy.report import Summary, made_on
from accuracy.runs import Results
from accuracy.settings import DIMENSIONS, Setting, Table
from cl import InputError
from psfs.common.files import write_text

#: The base setting of the thesis's tables: particle swarms over SP.
_BASE = {"method": "pso", "objective": "sp", "particles": 304, "layers": 10}
#: The thesis's tables by number: the dimensions that they vary, the last in columns, and their
#: values.
TABLES: dict[str, dict[str, list[Any]]] = {
    "6.1": {
        "particles": [96, 304, 496],
        "layers": [10, 15, 20],
        "objective": ["ws", "sp", "aosp", "posp", "aows"],
    },
    "6.4": {"method": ["sir", "pso"], "particles": [96, 204, 304, 512]},
    "6.5": {
        "objective": ["sp", *(f"sp@{count}" for count in (8, 18, 34, 66, 130, 258, 514))],
        "particles": [96, 304],
    },
    "6.8": {"particles": [100, 300, 500]},
    "6.9": {"particles": [50, 100, 200, 300, 500, 800], "layers": [5, 10, 15, 20]},
}
#: Tables that are figures in the thesis: error over particles, a curve for each number of
#: iterations; the thesis does not print their values.
FIGURES = {"6.9": "Thesis figures 6.9 and 6.19 to 6.21"}
_NOTE = (
    "mm, mean ± standard deviation of the runs' means; lost: runs in which a limb's end was lost. "
    "The thesis's deviations are those within its sequences."
)
#: Counterparts of the rows and columns of table 6.4: a particle filter evaluates as often as a
#: swarm.
_NAMES = {"sir": "particle filter (PF)", "pso": "PSO, 10 iterations"}


def thesis_plan(
    folder: Path, cameras: int, numbers: list[str], preset: str = ""
) -> dict[Table, list[Setting]]:
    """Return the settings of the tables with these numbers, on the sequence in `folder`, by a
    preset."""
    return {_table(number): _settings(number, folder.name, cameras, preset) for number in numbers}


def _settings(number: str, sequence: str, cameras: int, preset: str) -> list[Setting]:
    values = {"cameras": [cameras], "step": [1], **{name: [v] for name, v in _BASE.items()}}
    of = _table(number).settings(sequence, {**values, **TABLES[number]})
    return [replace(setting, preset=preset) for setting in of]


def write_thesis(path: Path, results: Results) -> None:
    """Write Markdown: the conditions of the runs, and each table after the thesis's own."""
    frames = max((run.frames for run in results.runs), default=0)
    about = f"{frames} frames; {_made_on(results)}. {_NOTE}"
    parts = ["# Errors by the tables of Rymut's thesis", papers()["rymut2016"]["citation"], about]
    absent = [number for number in TABLES if not _has_runs(number, results)]
    for number in TABLES:
        if number in absent:
            continue
        parts.append(f"## {FIGURES.get(number, f'Thesis table {number}')}")
        parts += [] if number in FIGURES else [_theirs(number).markdown()]
        parts.append(_ours(number, results).markdown())
    if absent:
        parts.append(f"Not run: tables {', '.join(absent)} (`accuracy.py FOLDER --thesis`).")
    write_text(path, "\n\n".join(parts) + "\n")


def publish_thesis(root: Path, results: Results) -> None:
    """Write thesis.md beside the results and, if they include it, table 6.4 into
    docs/accuracy.md."""
    write_thesis(results.path.with_name("thesis.md"), results)
    if _has_runs("6.4", results):
        replace_marked(root / "docs" / "accuracy.md", "thesis", thesis_headline(results))


def thesis_headline(results: Results) -> str:
    """Return Markdown for docs/accuracy.md: our table 6.4."""
    title = (
        "Particle filter and swarm over image features (SP), as many evaluations: mean error, mm"
    )
    return replace(_ours("6.4", results), title=title, note=f"{_made_on(results)}.").markdown()


def _made_on(results: Results) -> str:
    cameras = max((run.setting.cameras for run in results.runs), default=0)
    return f"{cameras} cameras, {made_on(results)}"


def _sequence(results: Results) -> str:
    """Return the one sequence that was tracked. Raises InputError for another number of them."""
    names = sorted({run.setting.sequence for run in results.runs})
    if len(names) != 1:
        raise InputError(f"{results.path}: {len(names)} sequences; expected one")
    return names[0]


def _table(number: str) -> Table:
    return Table(tuple(TABLES[number]))


def _theirs(number: str) -> Grid:
    """Return the thesis's table, with deviations beside the means."""
    table = papers()["rymut2016"]["tables"][number]
    places = [k for k, column in enumerate(table["columns"]) if column != "sd"]
    rows = [[_with_deviation(table, row, k) for k in places] for row in table["rows"]]
    return Grid(f"The thesis: {table['title']}", [table["columns"][k] for k in places], rows)


def _with_deviation(table: dict[str, Any], row: list[Any], place: int) -> str:
    shown = row[place] if isinstance(row[place], str) else quote(row[place])
    beside = table["columns"][place + 1 : place + 2] == ["sd"]
    return f"{shown} ± {quote(row[place + 1])}" if beside else shown


def _select_settings(number: str, results: Results) -> list[Setting]:
    """Return the table's settings for the sequence, the cameras and the preset of the runs."""
    cameras = max((run.setting.cameras for run in results.runs), default=0)
    preset = next((run.setting.preset for run in results.runs), "")
    return _settings(number, _sequence(results), cameras, preset)


def _has_runs(number: str, results: Results) -> bool:
    """Return whether a table has runs of its own, besides those that it shares with another."""
    settings = _select_settings(number, results)
    return 2 * sum(bool(results.select(setting)) for setting in settings) > len(settings)


def _ours(number: str, results: Results) -> Grid:
    table, varied = _table(number), TABLES[number]
    *heads, across = varied
    preset = next((run.setting.preset for run in results.runs), "")
    cells: dict[tuple[Any, ...], dict[Any, str]] = {}
    for setting in _select_settings(number, results):
        summary = Summary.create(results.select(setting))
        row = cells.setdefault(table.row_key(setting)[1:], {})
        row[table.column_key(setting)] = str(summary) if summary else NONE
    rows = [
        [*(_NAMES.get(v, str(v)) for v in row), *(of[c] for c in varied[across])]
        for row, of in cells.items()
    ]
    columns = [*(DIMENSIONS[name] for name in heads), *map(str, varied[across])]
    if number == "6.4":
        columns[1:] = [f"{10 * count} evaluations" for count in varied[across]]
    if not heads:  # a single row
        columns, rows = ["", *columns], [["OpenCL", *row] for row in rows]
    ours = f"Ours, --preset {preset}" if preset else "Ours"
    return Grid(f"{ours}: {', '.join(DIMENSIONS[name] for name in varied)}", columns, rows)
