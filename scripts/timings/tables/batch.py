"""Tables of `compare_timings.py batch`."""

from __future__ import annotations

from typing import Any

from timings.results import Results
from timings.tables.grid import Grid, number

#: The way in which takes begin, as in the settings of results; by default all at once.
ONE_AFTER_ANOTHER = "one after another"


def print_report(results: Results) -> None:
    for grid in make_tables(results):
        grid.show()


def make_tables(results: Results) -> list[Grid]:
    """Return tables: takes per minute, time of a take by stage, decoding cores."""
    rows = {
        name.removeprefix("workers "): section
        for name, section in results.sections.items()
        if name.startswith("workers ")
    }
    # Ascending by computing power, in whichever order they were measured.
    rows = dict(sorted(rows.items(), key=_size))
    grids = [throughput_table(rows), stages_table(rows)] if rows else []
    if any("core_stages" in row for row in rows.values()):
        grids.append(stages_table(rows, "core_stages", "CPU time of a take, s of a core"))
    if rows and "decoding" in results.sections:
        grids.append(decoding_table(results.sections["decoding"], rows))
    return grids


def _size(row: tuple[str, Any]) -> tuple[int, int, bool]:
    label, of = row
    return of["gpus"], of["workers"], "not" in label


def throughput_table(rows: dict[str, Any]) -> Grid:
    """Return the efficiency, takes per minute and worker against the first row's, and the speed-up
    against it."""
    first = next(iter(rows.values()))
    return Grid(
        "Takes per minute",
        ["workers", "takes", "takes/min", "frames/s", "speed-up", "efficiency",
         "core s/take", "cores busy"],
        [
            [
                label, str(row["takes"]), number(row["per_minute"]), number(row["frames_per_s"]),
                f"{row['per_minute'] / first['per_minute']:.2f} x",
                f"{100 * row['per_minute'] / first['per_minute'] / _units(row, first):.0f} %",
                number(row["core_s"]), number(row["core_s"] * row["per_minute"] / 60),
            ]
            for label, row in rows.items()
        ],
    )  # fmt: skip


def _units(row: Any, first: Any) -> float:
    """Return the computing power against the first row: number of GPUs; 1 for a CPU, which always
    uses all cores."""
    return max(1, row["gpus"]) / max(1, first["gpus"])


def stages_table(
    rows: dict[str, Any], of: str = "stages", title: str = "Where a take's time goes, s"
) -> Grid:
    """Return a table of each row's stages, under the key `of`."""
    stages = list(dict.fromkeys(stage for row in rows.values() for stage in row.get(of, {})))
    spent = {
        label: [number(row.get(of, {}).get(stage, 0.0)) for stage in stages]
        for label, row in rows.items()
    }
    found = [[label, *cells] for label, cells in spent.items()]
    return Grid(title, ["workers", *stages], found)


def decoding_table(decoding: Any, rows: dict[str, Any]) -> Grid:
    """Return the number of cores that decode as many frames per second as the workers track."""
    return Grid(
        f"Decoding: {number(decoding['core_ms'])} ms of a core per frame of all cameras",
        ["workers", "cores that decode", "frames/s"],
        [
            [label, number(row["frames_per_s"] * decoding["core_ms"] / 1e3),
             number(row["frames_per_s"])]
            for label, row in rows.items()
        ],
    )  # fmt: skip
