"""The thesis's tables 6.2 to 6.7, ours beside them where we have a counterpart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from timings.report.machines import Machine, device_title, named
from timings.tables.grid import NONE, Grid, number, quoted
from timings.tables.methods import SEARCHES
from timings.tables.objective import table_6_7
from timings.tables.whole import papers

_OPENING = """Whole frames from pictures to pose by particle swarm (PSO) and particle filter (PF)
over the images' objective function; the synthetic walk in place of P1S, P1D, P2S and LeeWalk, so
errors are of another person, room and camera than the thesis's. CPU: OpenCL on all cores."""


def tables(machines: Sequence[Machine]) -> str:
    """The chapter, as far as `methods` and `objective` were measured."""
    measured = [machine for machine in machines if "methods" in machine.results]
    evaluated = [machine for machine in machines if "objective" in machine.results]
    if not measured and not evaluated:
        return ""
    thesis = papers()["rymut2016"]
    parts = [
        "## The tables of Rymut's thesis",
        f"{thesis['citation']}. {thesis['setting']}.",
        _OPENING,
    ]
    makers: dict[str, Callable[[Machine], Grid | None]] = {
        "6.2": lambda m: _times(m, ("pso",), (100, 300, 1000)),
        "6.3": lambda m: _times(m, ("sir", "pso"), (100, 200, 300, 400, 1000, 2000, 3000, 4000)),
        "6.4": _accuracy,
        "6.5": _shapes,
        "6.6": lambda m: _times(m, ("pso",), (100, 200, 300, 400)),
    }
    for name, make in makers.items():
        grids = [grid for grid in map(make, measured) if grid]
        parts += [f"### Thesis table {name}", _theirs(name).markdown()]
        parts += [grid.markdown() for grid in grids]
    parts += ["### Thesis table 6.7", _theirs("6.7").markdown()]
    parts += [_on(machine) for machine in evaluated]
    return "\n\n".join(parts)


def _on(machine: Machine) -> str:
    """Our table 6.7 for every number of hypotheses."""
    results = machine.results["objective"]
    grids = [table_6_7(results, n) for n in results.settings["hypotheses"]]
    shown = [replace(grid, title=f"Ours, {machine.title}: {grid.title}") for grid in grids]
    return named("\n\n".join(grid.markdown() for grid in shown), machine)


def _theirs(name: str) -> Grid:
    """The thesis's own table, as printed."""
    table = papers()["rymut2016"]["tables"][name]
    rows = [
        [cell if isinstance(cell, str) else quoted(cell) for cell in row] for row in table["rows"]
    ]
    note = table.get("note", "")
    return Grid(f"Rymut 2016, table {name}: {table['title']}", table["columns"], rows, note)


def _sections(machine: Machine, prefix: str) -> list[Any]:
    """The CPU's section first, then the GPUs'."""
    found = machine.results["methods"].starting(prefix)
    return sorted(found, key=lambda section: section["cores"] is None)


def _times(machine: Machine, searches: Sequence[str], particles: Sequence[int]) -> Grid | None:
    """Time of a frame on the CPU and the GPUs, and how many times as fast these are."""
    sections = _sections(machine, "frames ")
    if not sections:
        return None
    by_run = [{(r["search"], r["particles"]): r["frames"] for r in s["rows"]} for s in sections]
    rows = []
    for search in searches:
        for n in particles:
            timings = [runs.get((search, n)) for runs in by_run]
            if timings[0] is None:
                continue
            row = [SEARCHES[search], f"{n:,}"]
            for timing in timings:
                row += [NONE if timing is None else str(timing)]
            for timing in timings[1:]:
                row += [
                    NONE if timing is None else f"{number(timings[0].median / timing.median)} x"
                ]
            rows.append(row)
    titles = [device_title(section["label"], machine) for section in sections]
    heads = ["algorithm", "particles", *(f"{title}, ms" for title in titles)]
    heads += [f"CPU / {title}" for title in titles[1:]]
    return Grid(f"Ours, {machine.title}: time of a frame, median [quartiles]", heads, rows)


def _accuracy(machine: Machine) -> Grid | None:
    section = machine.results["methods"].sections.get("accuracy")
    if section is None:
        return None
    iterations = machine.results["methods"].settings["iterations"]
    errors: dict[str, dict[int, float]] = {"sir": {}, "pso": {}}
    for row in section["rows"]:
        n = row["particles"] * (iterations if row["search"] == "pso" else 1)
        errors[row["search"]][n] = row["error_mm"]
    evaluations = sorted({n for found in errors.values() for n in found})
    rows = [
        [SEARCHES[search], *(number(found.get(n)) for n in evaluations)]
        for search, found in errors.items()
    ]
    heads = ["algorithm", *(f"{n:,} evaluations" for n in evaluations)]
    return Grid(f"Ours, {machine.title}: mean error of the joints, mm", heads, rows)


def _shapes(machine: Machine) -> Grid | None:
    sections = _sections(machine, "shapes ")
    if not sections:
        return None
    particles = sorted({row["particles"] for row in sections[0]["rows"]})
    by_run = [{(r["vertices"], r["particles"]): r for r in s["rows"]} for s in sections]
    titles = [device_title(section["label"], machine) for section in sections]
    rows = []
    for vertices in sorted({row["vertices"] for row in sections[0]["rows"]}):
        row = [str(vertices)]
        for n in particles:
            runs = [found[vertices, n] for found in by_run]
            row += [str(run["frames"]) for run in runs] + [number(runs[-1]["error_mm"])]
        rows.append(row)
    heads = [f"{n}: {what}" for n in particles for what in (*(f"{t}, ms" for t in titles), "mm")]
    return Grid(f"Ours, {machine.title}: time and error of a frame by vertices per part",
                ["vertices", *heads], rows)  # fmt: skip
