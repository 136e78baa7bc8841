"""Tables of `compare_timings.py psfs`, without the sections that were left out."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from psfs.cli.commandline import stdout
from timings.measure import Timing
from timings.results import Results
from timings.stages import STAGES
from timings.tables.grid import number
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
    _print_comparison(results)
    for device in devices:
        for mode in MODES:
            _print_stages(device, mode)
    _print_cores(devices)
    _print_growth([row for rows in results.starting("growth ") for row in rows])
    memory = results.sections.get("memory")
    if memory:
        stdout.print(
            f"memory: {memory['after_50_mb']:.0f} MB after 50 streamed frames, "
            f"{memory['after_all_mb']:.0f} MB after {memory['frames']}"
        )


def compare_programs(results: Results) -> list[tuple[str, str, Timing]]:
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


def _print_comparison(results: Results) -> None:
    peers = {"x Open3D": ("open3d", "carving"), "x NumPy": ("numpy", "whole")}
    peers = {k: v for k, v in peers.items() if v[0] in results.sections}
    medians = {k: results.sections[a][b].median for k, (a, b) in peers.items()}
    nx, ny, nz = results.settings["shape"]
    title = f"One frame, {results.settings['views']} cameras, {nx} x {ny} x {nz} voxels"
    table = Table(title=title)
    table.add_column("program")
    for heading in ("ms, median [quartiles]", "least", *medians):
        table.add_column(heading, justify="right")
    for device, what, timing in compare_programs(results):
        ratios = (median / timing.median for median in medians.values())
        table.add_row(f"{device}, {what}", str(timing), *map(number, (timing.least, *ratios)))
    stdout.print(table)
    for device in results.starting("device "):
        for mode in MODES:
            timings = device[mode]["stages"]
            ms = sum(timings[stage].median for stage in SHAPE_STAGES if stage in timings)
            beside = "".join(f", {number(v / ms)} {k}" for k, v in medians.items())
            line = f"{device['label']}, {mode}: silhouette maps to surface {number(ms)} ms{beside}"
            stdout.print(line, soft_wrap=True)
    if "open3d" in results.sections:
        counts = results.sections["open3d"]
        stdout.print(
            f"Open3D keeps {counts['voxels_left']:,} voxels (any of 8 corners in the mask), "
            f"the centre test {counts['voxels_of_ours']:,}"
        )


def _print_stages(device: dict[str, Any], mode: str) -> None:
    limits = device["limits"]
    table = Table(
        title=f"{device['label']}, {mode}: device time by stage; at best "
        f"{limits.bytes_per_s / 1e9:,.0f} GB/s, {limits.flops_per_s / 1e9:,.0f} GFLOP/s (measured)"
    )
    table.add_column("stage")
    for heading in ("ms, median [quartiles]", "naive limit, ms", "limit / time"):
        table.add_column(heading, justify="right")
    stages = device[mode]["stages"]
    for stage in STAGES:
        if stage not in stages:
            continue
        limit = device[mode]["limits_ms"].get(stage)
        row = ("", "") if limit is None else (f"{limit:.3f}", f"{limit / stages[stage].median:.0%}")
        table.add_row(stage, str(stages[stage]), *row)
    stdout.print(table)


def _print_cores(devices: list[dict[str, Any]]) -> None:
    single = next((d for d in devices if d["cores"] == 1), None)
    if single is None:
        return
    table = Table(title="Speed-up over cores, whole frame")
    for heading in ("cores", "dense", "sparse"):
        table.add_column(heading, justify="right")
    for device in devices:
        if device["cores"] is None:
            continue
        ratios = (single[mode]["whole"].median / device[mode]["whole"].median for mode in MODES)
        table.add_row(str(device["cores"]), *(f"{ratio:.2f}" for ratio in ratios))
    stdout.print(table)


def _print_growth(rows: list[dict[str, Any]]) -> None:
    table = Table(title="Growth: whole frame from pictures")
    for heading in ("device", "mode", "voxels", "cameras", "ms, median [quartiles]"):
        table.add_column(heading, justify="left" if heading == "device" else "right")
    for row in rows:
        shape = " x ".join(str(n) for n in row["shape"])
        table.add_row(row["label"], row["mode"], shape, str(row["views"]), str(row["ms"]))
    stdout.print(table)
