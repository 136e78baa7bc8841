"""Tables of `compare_timings.py psfs`, without the sections that were left out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from psfs.cli.commandline import stdout
from timings.measure import Timing
from timings.results import Results
from timings.stages import STAGES
from timings.tables.grid import NONE, Grid, number
from timings.tables.whole import SPECIFICATION

#: The stages that correspond to carving alone.
SHAPE_STAGES = ("silhouette", "occupancy", "smoothing", "surface")
#: The modes of the reconstruction.
MODES = ("dense", "sparse")
#: The timed quantity of each mode, and its name there.
_RUNS = {
    "from pictures": "whole",
    "from masks": "masks",
    "with colour": "whole_coloured",
    "with colour, streamed": "stream_per_frame",
}


def print_report(results: Results) -> None:
    """Print the results, the most interesting first."""
    devices = results.starting("device ")
    comparison_table(results, "One frame").show()
    for line in _remarks(results, devices):
        stdout.print(line, soft_wrap=True)
    grids = [_stage_table(device, mode) for device in devices for mode in MODES]
    if any(device["cores"] == 1 for device in devices):
        grids.append(_core_table(devices))
    for grid in (*grids, *growth_tables(results)):
        grid.show()


def comparison_table(
    results: Results, title: str, name: Callable[[str], str] = lambda label: label
) -> Grid:
    """Return a whole frame of every program. name: returns the shown name of a device or
    program."""
    carving, twin = (results.sections.get(of) for of in ("open3d", "numpy"))
    peers = [carving and carving["carving"], twin and twin["whole"]]
    rows = [
        [
            f"{name(label)}, {what}", number(timing.median),
            f"{number(timing.low)} to {number(timing.high)}", number(timing.least),
            *(f"{number(of.median / timing.median)} x" if of else NONE for of in peers),
        ]
        for label, what, timing in _compare_programs(results)
    ]  # fmt: skip
    nx, ny, nz = results.settings["shape"]
    return Grid(
        f"{title}: {results.settings['views']} cameras, {nx} x {ny} x {nz} voxels",
        ["program", "median, ms", "quartiles", "least", "Open3D : it", "NumPy : it"], rows,
    )  # fmt: skip


def growth_tables(results: Results, name: Callable[[str], str] = lambda label: label) -> list[Grid]:
    """Return a table for every device: voxels up to 512^3, and cameras. name: returns the shown
    name of a device."""
    heads = ["mode", "voxels", "cameras", "ms, median [quartiles]"]
    return [
        Grid(
            f"{name(section.removeprefix('growth '))}: growth with voxels and cameras",
            heads,
            [
                [row["mode"], " x ".join(map(str, row["shape"])), str(row["views"]), str(row["ms"])]
                for row in rows
            ],
        )
        for section, rows in results.sections.items()
        if section.startswith("growth ")
    ]


def _compare_programs(results: Results) -> list[tuple[str, str, Timing]]:
    """Return a whole frame of every program: the program or its device, its output, its time."""
    rows = []
    if "open3d" in results.sections:
        carving = results.sections["open3d"]["carving"]
        rows.append(("Open3D carve_silhouette", "carving alone", carving))
    if "numpy" in results.sections:
        twin = results.sections["numpy"]
        rows.append((f"NumPy, {SPECIFICATION}", "occupancy alone", twin["occupancy"]))
        rows.append((f"NumPy, {SPECIFICATION}", "whole", twin["whole"]))
    for device in results.starting("device "):
        for mode in MODES:
            for what, name in _RUNS.items():
                rows.append((device["label"], f"{mode}, {what}", device[mode][name]))
    return rows


def _remarks(results: Results, devices: list[dict[str, Any]]) -> list[str]:
    """Return lines on carving alone, and on memory."""
    lines, counts = [], results.sections.get("open3d")
    for device in devices:
        for mode in MODES:
            timings = device[mode]["stages"]
            ms = sum(timings[stage].median for stage in SHAPE_STAGES if stage in timings)
            line = f"{device['label']}, {mode}: silhouette maps to surface {number(ms)} ms"
            beside = f", {number(counts['carving'].median / ms)} x Open3D" if counts else ""
            lines.append(line + beside)
    if counts:
        lines.append(
            f"Open3D keeps {counts['voxels_left']:,} voxels (any of 8 corners in the mask), "
            f"the centre test {counts['voxels_of_ours']:,}"
        )
    if memory := results.sections.get("memory"):
        lines.append(
            f"memory: {memory['after_50_mb']:.0f} MB after 50 streamed frames, "
            f"{memory['after_all_mb']:.0f} MB after {memory['frames']}"
        )
    return lines


def _stage_table(device: dict[str, Any], mode: str) -> Grid:
    limits, stages, naive = device["limits"], device[mode]["stages"], device[mode]["limits_ms"]
    rows = []
    for stage in (stage for stage in STAGES if stage in stages):
        limit = naive.get(stage)
        share = NONE if limit is None else f"{limit / stages[stage].median:.0%}"
        rows.append([stage, str(stages[stage]), number(limit), share])
    title = (
        f"{device['label']}, {mode}: device time by stage; at best "
        f"{limits.bytes_per_s / 1e9:,.0f} GB/s, {limits.flops_per_s / 1e9:,.0f} GFLOP/s (measured)"
    )
    heads = ["stage", "ms, median [quartiles]", "naive limit, ms", "limit / time"]
    return Grid(title, heads, rows)


def _core_table(devices: list[dict[str, Any]]) -> Grid:
    single = next(device for device in devices if device["cores"] == 1)
    rows = [
        [
            str(device["cores"]),
            *(
                f"{single[mode]['whole'].median / device[mode]['whole'].median:.2f}"
                for mode in MODES
            ),
        ]
        for device in devices
        if device["cores"] is not None
    ]
    return Grid("Speed-up over cores, whole frame", ["cores", *MODES], rows)
