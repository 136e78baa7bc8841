"""Our counterparts of Rymut 2016, table 6.7 and fig. 6.16, and of Kwolek & Rymut 2016, table 1."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from timings.measure import Timing
from timings.results import Results
from timings.tables.grid import Grid, number

#: Rows of the thesis's table; our kernels render and count in one, so (c) holds both.
ROWS = {
    "matrices": "a) matrices",
    "upload": "b) transfer to OpenGL",
    "rendering": "c) rendering (OpenCL: and counting)",
    "download": "d) transfer from OpenGL",
    "objective": "e) objective",
    "overhead": "f) overhead (g less a to e)",
    "total": "g) total",
    "whole": "the whole, without waiting in between",
}
_PARTS = tuple(ROWS)[:5]
#: Kwolek & Rymut's rows, as sums of the thesis's.
_KWOLEK = {
    "world transformation matrices": ("matrices",),
    "sending them to OpenGL": ("upload",),
    "OpenGL rendering": ("rendering",),
    "acquiring the result from OpenGL": ("download",),
    "evaluating the fitness": ("objective", "overhead"),
    "overall time": ("total",),
    "compute time (without acquisition, mapping, transmission)": ("matrices", "rendering",
                                                                  "objective"),
}  # fmt: skip
_KERNELS = {
    "pose_cones": "matrices",
    "place_parts": "rendering",
    "count_pixels": "rendering",
    "score_counts": "objective",
}
_NOTE = (
    "Medians; f is what makes them add up: launching, waiting. OpenCL draws and counts in one "
    "kernel; poses, features and cameras are on the device already, as in the tracker; kernels by "
    "the device's events. OpenCL + OpenGL: OpenCL poses the bodies, OpenGL draws, counts and "
    "scores, of which the scores alone come back; every part is waited for. The last row is "
    "measured apart, as the tracker runs it, without events and waiting."
)


def print_report(results: Results) -> None:
    for n in results.settings["hypotheses"]:
        table_6_7(results, n).show()
        kwolek_1(results, n).show()
    for _, section in group_sections(results):
        groups(section, section["label"], results.settings).show()


def columns(results: Results, n: int) -> dict[str, dict[str, float]]:
    """Return the times, ms, of the parts of one evaluation of `n` hypotheses, by implementation:
    fewest cores first."""
    found: dict[str, dict[str, float]] = {}
    twin = results.sections.get("numpy")
    if twin is not None:
        parts = {part: twin[part] for part in ("matrices", "rendering", "objective")}
        found["NumPy (an unoptimised specification)"] = _scale_parts(parts, twin["hypotheses"], n)
    counted = results.sections.get("opengl, NumPy")
    if counted is not None:
        parts = {part: counted[part].median for part in _PARTS}
        found[counted["label"]] = _scale_parts(parts, counted["hypotheses"], n)
    by_name = dict(results.sections)
    for name in sorted(by_name, key=lambda name: by_name[name].get("cores") or 0):
        if name.startswith("device "):
            found[f"OpenCL {name.removeprefix('device ')}"] = _sum_kernels(_row(by_name[name], n))
    for name, section in by_name.items():
        if name.startswith("opengl ") and not name.endswith("NumPy"):
            title = f"OpenCL {section['label']} + OpenGL {section['renderer']}"
            row = _row(section, n)
            ms = {part: row["parts"][part].median for part in _PARTS}
            found[title] = _complete(ms, row["parts"]["total"].median, row.get("whole"))
    return found


def table_6_7(results: Results, n: int) -> Grid:
    """Return a table of one evaluation of `n` hypotheses, ms; a column for each implementation."""
    found, views = columns(results, n), results.settings["views"]
    rows = [
        [title, *(number(column.get(part)) for column in found.values())]
        for part, title in ROWS.items()
    ]
    totals = [column["rendering"] for column in found.values()]
    rows.append(["c) per view, us", *(number(1e3 * ms / (n * views)) for ms in totals)])
    title = f"One evaluation of {n} hypotheses x {views} cameras, ms (Rymut 2016, table 6.7)"
    return Grid(title, ["operation", *found], rows, _NOTE + _note_fewer(results))


def kwolek_1(results: Results, n: int) -> Grid:
    """Return the same by the rows of Kwolek & Rymut 2016, table 1."""
    found = columns(results, n)
    rows = [
        [title, *(number(_sum(column, parts)) for column in found.values())]
        for title, parts in _KWOLEK.items()
    ]
    title = f"One evaluation of {n} hypotheses, ms (Kwolek & Rymut 2016, table 1)"
    return Grid(title, ["operation", *found], rows, _note_fewer(results).strip())


def group_sections(results: Results) -> list[tuple[str, Any]]:
    """Return the implementations that count the pixels, with their sections of fig. 6.16; of OpenGL
    also what it drew on, which need not be the device that poses the bodies."""
    found = []
    for name, section in results.sections.items():
        if name.startswith("groups of OpenGL, "):
            drawn = results.sections.get(f"opengl {name.removeprefix('groups of OpenGL, ')}", {})
            found.append((f"drawn by OpenGL on {drawn.get('renderer', 'its device')}", section))
        elif name.startswith("groups "):
            found.append(("OpenCL", section))
    return found


def groups(section: Any, title: str, settings: Mapping[str, Any]) -> Grid:
    """Return fig. 6.16 as a table: medians over the frames."""
    rows = [[row["group"], str(row["frames"])] for row in section["rows"]]
    return Grid(
        f"{title}: one evaluation of {settings['group_hypotheses']} hypotheses by size of the "
        "work-groups that count pixels (Rymut 2016, fig. 6.16)",
        ["work-group", "ms, median over frames [quartiles]"], rows,
        f"{settings['frames']} frames.",
    )  # fmt: skip


def _note_fewer(results: Results) -> str:
    """Return a note on columns that were measured with fewer hypotheses."""
    names = [name for name in ("numpy", "opengl, NumPy") if name in results.sections]
    if not names:
        return ""
    counts = {results.sections[name]["hypotheses"] for name in names}
    shown = ", ".join(map(str, sorted(counts)))
    return (
        f" Where NumPy counts, times are those of {shown} hypotheses, one frame, times the ratio."
    )


def _row(section: Mapping[str, Any], n: int) -> Mapping[str, Any]:
    return next(row for row in section["rows"] if row["hypotheses"] == n)


def _scale_parts(parts: Mapping[str, float], measured: int, n: int) -> dict[str, float]:
    ms = {part: value * n / measured for part, value in parts.items()}
    return {**ms, "total": sum(ms.values())}


def _complete(ms: dict[str, float], total: float, whole: Timing | None) -> dict[str, float]:
    apart = {} if whole is None else {"whole": whole.median}
    return {**ms, "overhead": total - sum(ms.values()), "total": total, **apart}


def _sum(column: Mapping[str, float], parts: tuple[str, ...]) -> float | None:
    known = [column[part] for part in parts if part in column]
    return sum(known) if known else None


def _sum_kernels(row: Mapping[str, Any]) -> dict[str, float]:
    ms = dict.fromkeys(_KERNELS.values(), 0.0)
    kernels: Mapping[str, Timing] = row["kernels"]
    for name, timing in kernels.items():
        ms[_KERNELS[name]] += timing.median
    return _complete(ms, row["total"].median, row.get("whole"))
