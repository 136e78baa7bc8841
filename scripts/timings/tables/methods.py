"""Tables of `compare_timings.py methods`."""

from __future__ import annotations

from typing import Any

from timings.results import Results
from timings.tables.grid import Grid, number

#: What the thesis calls them.
SEARCHES = {"pso": "PSO", "sir": "PF"}


def print_report(results: Results) -> None:
    for section in results.starting("frames "):
        frames_table(section, section["label"], results.settings).show()
    for section in results.starting("shapes "):
        shapes_table(section, section["label"]).show()


def frames_table(section: Any, title: str, settings: Any) -> Grid:
    rows = [
        [_search(row, settings), f"{row['particles']:,}", str(row["frames"]),
         number(1e3 / row["frames"].median), number(row["error_mm"])]
        for row in section["rows"]
    ]  # fmt: skip
    return Grid(
        f"Whole frames on {title}",
        ["search", "particles", "ms, median [quartiles]", "frames/s", "error, mm"], rows,
    )  # fmt: skip


def _search(row: Any, settings: Any) -> str:
    name = SEARCHES[row["search"]]
    return f"{name}, {settings['iterations']} iterations" if row["search"] == "pso" else name


def shapes_table(section: Any, title: str) -> Grid:
    rows = [
        [str(row["vertices"]), str(row["particles"]), str(row["frames"]), number(row["error_mm"])]
        for row in section["rows"]
    ]
    return Grid(
        f"Shapes of the body's parts on {title}",
        ["vertices per part", "particles", "ms, median [quartiles]", "error, mm"], rows,
    )  # fmt: skip
