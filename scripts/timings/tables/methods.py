"""Tables of `compare_timings.py methods`."""

from __future__ import annotations

from typing import Any

import numpy as np

from timings.results import Results
from timings.tables.grid import Grid, number

#: Their names in the thesis.
SEARCHES = {"pso": "PSO", "sir": "PF"}


def print_report(results: Results) -> None:
    settings = results.settings
    for name, section in results.sections.items():
        kind, label = name.split(" ")[0], section["label"]
        if kind in ("frames", "opengl"):
            title = f"{label}, drawn by OpenGL" if kind == "opengl" else label
            frames_table(section, title, settings).show()
        elif kind in TABLES:
            TABLES[kind](section, label).show()


def frames_table(section: Any, title: str, settings: Any) -> Grid:
    """Return time and error of whole frames by search and particles."""
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
    """Return table 6.5."""
    rows = [
        [str(row["vertices"]), str(row["particles"]), str(row["frames"]), number(row["error_mm"])]
        for row in section["rows"]
    ]
    return Grid(
        f"Shapes of the body's parts on {title}",
        ["vertices per part", "particles", "ms, median [quartiles]", "error, mm"], rows,
    )  # fmt: skip


def curves_table(section: Any, title: str) -> Grid:
    """Return figures 6.9, 6.10, 6.19 to 6.21 as a table: a row for every number of particles."""
    by_run = {(row["iterations"], row["particles"]): row for row in section["rows"]}
    iterations, particles = (sorted({key[k] for key in by_run}) for k in (0, 1))
    rows = []
    for n in particles:
        found = [by_run[i, n] for i in iterations]
        errors = [number(float(np.mean(row["errors_mm"]))) for row in found]
        rows.append([str(n), *errors, *(number(1e3 / row["frames"].median) for row in found)])
    heads = [f"{i} iterations: {what}" for what in ("mm", "frames/s") for i in iterations]
    seeds = len(section["rows"][0]["errors_mm"])
    return Grid(
        f"{title}: error and rate of PSO by particles and iterations", ["particles", *heads], rows,
        f"Mean error of {seeds} seed{'s' * (seeds > 1)}; rates by the median frame.",
    )  # fmt: skip


def shares_table(section: Any, title: str) -> Grid:
    """Return figures 6.11 and 6.17 as a table."""
    rows = []
    for row in section["rows"]:
        whole, without = row["search"].median, row["without"].median
        share = max(0.0, 1 - without / whole)
        rows.append([str(row["particles"]), number(whole), number(without), f"{share:.0%}"])
    drawn = {"opencl": "OpenCL", "opengl": "OpenGL"}[section["renderer"]]
    return Grid(
        f"{title}, drawn by {drawn}: share of the objective in a frame's search",
        ["particles", "search, ms", "without an objective, ms", "objective"], rows,
        "Medians, features being there; PSO with 10 iterations.",
    )  # fmt: skip


def online_table(section: Any, title: str) -> Grid:
    """Return figure 6.23 as a table."""
    rows = [
        [str(row["particles"]), str(row["frames"]), number(row["offline_mm"]),
         number(row["online_mm"]), f"{row['share']:.0%}"]
        for row in section["rows"]
    ]  # fmt: skip
    return Grid(
        f"{title}: tracked offline, and online, while footage plays",
        [
            "particles",
            "ms, median [quartiles]",
            "offline, mm",
            "online, mm",
            "frames tracked online",
        ],
        rows,
        "Online the next frame is the newest when the one before is done; by measured times.",
    )


#: The tables of kinds of sections.
TABLES = {
    "shapes": shapes_table,
    "curves": curves_table,
    "shares": shares_table,
    "online": online_table,
}
