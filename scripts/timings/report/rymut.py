"""The thesis's tables 6.2 to 6.7 and curves, and Kwolek & Rymut's tables, beside our
counterparts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from timings.report.machines import Machine, device_title, missing, name_processors
from timings.tables.grid import NONE, Grid, number, quote
from timings.tables.methods import SEARCHES, TABLES
from timings.tables.objective import group_sections, groups, kwolek_1, table_6_7
from timings.tables.whole import papers

_OPENING = """Whole frames from pictures to pose by particle swarm (PSO) and particle filter (PF)
over the images' objective function SP and the body rymut31; the synthetic walk in place of P1S,
P1D, P2S and LeeWalk, so errors are of another person, room and camera than the thesis's, and of a
short walk: those of a whole sequence and ten seeds are in
`scripts/results/accuracy/thesis/thesis.md`. CPU: OpenCL on all cores. OpenGL: hypotheses drawn,
counted and scored by OpenGL."""


@dataclass(frozen=True)
class _Chapter:
    """A heading; the paper's own table, or a figure of ours; our grids of a machine; the sections
    and the comparison that they come from."""

    heading: str
    make: Callable[[Machine], Sequence[Grid | None]]
    comparison: str
    prefixes: tuple[str, ...]
    paper: str = "rymut2016"
    table: str = ""
    figure: str = ""


def tables(machines: Sequence[Machine]) -> str:
    """Return the chapter; what was not measured is named in its place."""
    thesis, kwolek = papers()["rymut2016"], papers()["kwolek2016"]
    parts = [
        "## The tables and curves of Rymut's thesis",
        f"{thesis['citation']}. {thesis['setting']}.",
        _OPENING,
        *_write_chapters(_THESIS, machines),
        "## The tables of Kwolek & Rymut",
        f"{kwolek['citation']}. {kwolek['setting']}.",
        *_write_chapters(_KWOLEK, machines),
    ]
    return "\n\n".join(parts)


def _write_chapters(chapters: Sequence[_Chapter], machines: Sequence[Machine]) -> list[str]:
    parts = []
    for chapter in chapters:
        parts.append(f"### {chapter.heading}")
        if chapter.table:
            parts.append(_theirs(chapter.paper, chapter.table).markdown())
        if chapter.figure:
            parts.append(f"![{chapter.heading}](figures/{chapter.figure}.svg)")
        for machine in machines:
            if chapter.comparison in machine.results:
                parts += [
                    name_processors(g.markdown(), machine) for g in chapter.make(machine) if g
                ]
            parts += missing(machine, chapter.comparison, *chapter.prefixes)
    return parts


def _by_hypotheses(
    make: Callable[[Any, int], Grid],
) -> Callable[[Machine], Sequence[Grid | None]]:
    """Return a function that makes a grid for every number of hypotheses of `objective`."""

    def grids(machine: Machine) -> list[Grid | None]:
        results = machine.results["objective"]
        if not results.starting("device "):
            return []
        made = [make(results, n) for n in results.settings["hypotheses"]]
        return [replace(grid, title=f"Ours, {machine.title}: {grid.title}") for grid in made]

    return grids


def _work_groups(machine: Machine) -> list[Grid | None]:
    results = machine.results["objective"]
    return [
        groups(section, f"Ours, {machine.title}: {section['label']}, {what}", results.settings)
        for what, section in group_sections(results)
    ]


def _one_each(kind: str) -> Callable[[Machine], Sequence[Grid | None]]:
    """Return a function that makes the grid of every section of that kind."""

    def grids(machine: Machine) -> list[Grid | None]:
        return [
            TABLES[kind](section, f"Ours, {device_title(section['label'], machine)}")
            for section in machine.results["methods"].starting(f"{kind} ")
        ]

    return grids


def _theirs(paper: str, name: str) -> Grid:
    """Return a paper's own table, as printed."""
    table = papers()[paper]["tables"][name]
    rows = [
        [cell if isinstance(cell, str) else quote(cell) for cell in row] for row in table["rows"]
    ]
    note = table.get("note", "")
    return Grid(
        f"{papers()[paper]['short']}, table {name}: {table['title']}", table["columns"], rows, note
    )


def _sections(machine: Machine, prefix: str) -> list[Any]:
    """Return the CPU's section first, then the GPUs'."""
    found = machine.results["methods"].starting(prefix)
    return sorted(found, key=lambda section: section["cores"] is None)


def _times(
    machine: Machine, searches: Sequence[str], particles: Sequence[int], opengl: bool = False
) -> Grid | None:
    """Return the time of a frame on the CPU and the GPUs, and the GPUs' speed-up."""
    sections = [(s, "") for s in _sections(machine, "frames ")]
    if opengl:
        sections += [(s, ", OpenGL") for s in _sections(machine, "opengl frames ")]
    if not sections:
        return None
    by_run = [{(r["search"], r["particles"]): r["frames"] for r in s["rows"]} for s, _ in sections]
    rows = []
    for search in searches:
        for n in particles:
            timings = [runs.get((search, n)) for runs in by_run]
            if timings[0] is None:
                continue
            row = [SEARCHES[search], f"{n:,}"]
            for timing in timings:
                row += [NONE if timing is None else f"{timing}, {len(timing.samples)}"]
            for timing in timings[1:]:
                row += [
                    NONE if timing is None else f"{number(timings[0].median / timing.median)} x"
                ]
            rows.append(row)
    titles = [device_title(s["label"], machine) + drawn for s, drawn in sections]
    heads = ["algorithm", "particles", *(f"{title}, ms" for title in titles)]
    heads += [f"{titles[0]} : {title}" for title in titles[1:]]
    title = f"Ours, {machine.title}: time of a frame, median [quartiles], frames"
    return Grid(title, heads, rows)


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


_THESIS = (
    _Chapter(
        "Thesis table 6.2", lambda m: [_times(m, ("pso",), (100, 300, 1000))],
        "methods", ("frames ",), table="6.2",
    ),
    _Chapter(
        "Thesis table 6.3",
        lambda m: [_times(m, ("sir", "pso"), (100, 200, 300, 400, 1000, 2000, 3000, 4000))],
        "methods", ("frames ",), table="6.3",
    ),
    _Chapter(
        "Thesis table 6.4", lambda m: [_accuracy(m)], "methods", ("accuracy",), table="6.4"
    ),
    _Chapter("Thesis table 6.5", lambda m: [_shapes(m)], "methods", ("shapes ",), table="6.5"),
    _Chapter(
        "Thesis table 6.6",
        lambda m: [_times(m, ("pso",), (100, 200, 300, 400), opengl=True)],
        "methods", ("frames ", "opengl frames "), table="6.6",
    ),
    _Chapter(
        "Thesis table 6.7", _by_hypotheses(table_6_7), "objective",
        ("device ", "opengl ", "opengl, NumPy", "numpy"), table="6.7",
    ),
    _Chapter(
        "Thesis figures 6.9, 6.10 and 6.19 to 6.21: error and rate over particles",
        _one_each("curves"), "methods", ("curves ",), figure="swarm_curves",
    ),
    _Chapter(
        "Thesis figures 6.11 and 6.17: share of the objective", _one_each("shares"), "methods",
        ("shares ",), figure="objective_shares",
    ),
    _Chapter(
        "Thesis figure 6.16: size of the work-groups", _work_groups, "objective", ("groups ",),
        figure="work_groups",
    ),
    _Chapter(
        "Thesis figure 6.23: online against offline", _one_each("online"), "methods", ("online ",),
        figure="online",
    ),
)  # fmt: skip
_KWOLEK = (
    _Chapter(
        "Kwolek & Rymut table 1", _by_hypotheses(kwolek_1), "objective",
        ("device ", "opengl ", "opengl, NumPy", "numpy"), "kwolek2016", "1",
    ),
    _Chapter(
        "Kwolek & Rymut table 2", lambda m: [_accuracy(m)], "methods", ("accuracy",),
        "kwolek2016", "2",
    ),
    _Chapter(
        "Kwolek & Rymut table 3", lambda m: [_shapes(m)], "methods", ("shapes ",),
        "kwolek2016", "3",
    ),
)  # fmt: skip
