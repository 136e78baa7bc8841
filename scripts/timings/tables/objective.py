"""Our counterpart of Rymut 2016, table 6.7."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from timings.results import Results
from timings.tables.grid import Grid, number

#: Rows of the thesis's table; ours draws and counts in one, so that (c) holds both.
ROWS = {
    "matrices": "a) matrices",
    "upload": "b) transfer to OpenGL",
    "rendering": "c) rendering (OpenCL: and counting)",
    "download": "d) transfer from OpenGL",
    "objective": "e) objective",
    "overhead": "f) overhead",
    "total": "g) total",
}
_KERNELS = {
    "pose_cones": "matrices",
    "place_parts": "rendering",
    "count_pixels": "rendering",
    "score_counts": "objective",
}


def print_report(results: Results) -> None:
    for n in results.settings["hypotheses"]:
        table_6_7(results, n).show()


def table_6_7(results: Results, n: int) -> Grid:
    """ms of one evaluation of `n` hypotheses; a column for each way to make it."""
    columns = {}
    twin = results.sections.get("numpy")
    if twin is not None:
        columns["NumPy twin"] = _of_twin(twin, n)
    opengl = results.sections.get("opengl")
    if opengl is not None:
        columns[f"{opengl['label']}, NumPy"] = _medians(_row(opengl, n))
    for device in results.starting("device "):
        used = next(k for k, v in results.sections.items() if v is device)
        columns[used.removeprefix("device ")] = _of_device(_row(device, n))
    views = results.settings["views"]
    rows = [
        [title, *(number(column.get(part)) for column in columns.values())]
        for part, title in ROWS.items()
    ]
    totals = [column["rendering"] for column in columns.values()]
    rows.append(["c) per view, us", *(number(1e3 * ms / (n * views)) for ms in totals)])
    title = f"One evaluation of {n} hypotheses x {views} cameras, ms (Rymut 2016, table 6.7)"
    note = (
        "Medians. OpenCL draws and counts in one kernel, in row c; poses, features "
        "and cameras are on the device already, as in the tracker."
    )
    if twin is not None:
        note += f" The twin's times are those of {twin['hypotheses']} hypotheses times their ratio."
    return Grid(title, ["operation", *columns], rows, note)


def _row(section: Mapping[str, Any], n: int) -> Mapping[str, Any]:
    return next(row for row in section["rows"] if row["hypotheses"] == n)


def _of_twin(twin: Mapping[str, Any], n: int) -> dict[str, float]:
    parts = ("matrices", "rendering", "objective")
    ms = {part: twin[part] * n / twin["hypotheses"] for part in parts}
    return {**ms, "total": sum(ms.values())}


def _medians(row: Mapping[str, Any]) -> dict[str, float]:
    return {part: row[part].median for part in ROWS if part in row}


def _of_device(row: Mapping[str, Any]) -> dict[str, float]:
    ms = dict.fromkeys(_KERNELS.values(), 0.0)
    for name, timing in row["kernels"].items():
        ms[_KERNELS[name]] += timing.median
    total = row["total"].median
    return {**ms, "overhead": max(0.0, total - sum(ms.values())), "total": total}
