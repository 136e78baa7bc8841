"""Tables and plot of `compare_timings.py psfs`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from rich.table import Table

from psfs.commandline import stdout
from psfs.files import written_whole
from timings.measure import Timing
from timings.psfs_work import SHAPE_STAGES, STAGES

_COLOURS = ("#9aa5b1", "#4c78a8", "#f58518", "#e45756", "#72b7b2", "#b279a2", "#54a24b", "#d4d4d4")


def print_report(results: dict[str, Any]) -> None:
    """What was measured, in the order of its interest."""
    _print_comparison(results)
    for device in results["devices"]:
        for mode in ("dense", "sparse"):
            _print_stages(device, mode)
    _print_cores(results["devices"])
    _print_growth(results["growth"])
    memory = results["memory"]
    stdout.print(
        f"memory: {memory['after_50_mb']:.0f} MB after 50 streamed frames, "
        f"{memory['after_all_mb']:.0f} MB after {memory['frames']}"
    )


def compared(results: dict[str, Any]) -> list[tuple[str, Timing]]:
    """Everybody's whole frame."""
    rows = [
        ("Open3D carve_silhouette, carving alone", results["open3d"]["carving"]),
        ("NumPy twin, occupancy alone", results["numpy"]["occupancy"]),
        ("NumPy twin, whole", results["numpy"]["whole"]),
    ]
    for device in results["devices"]:
        for mode in ("dense", "sparse"):
            rows.append((f"{device['label']}, {mode}, from pictures", device[mode]["whole"]))
            rows.append((f"{device['label']}, {mode}, from masks", device[mode]["masks"]))
            rows.append((f"{device['label']}, {mode}, with colour", device[mode]["whole_coloured"]))
            stream = device[mode]["stream_per_frame"]
            rows.append((f"{device['label']}, {mode}, with colour, streamed", stream))
    return rows


def _print_comparison(results: dict[str, Any]) -> None:
    carving, twin = results["open3d"]["carving"], results["numpy"]["whole"]
    nx, ny, nz = results["shape"]
    table = Table(title=f"One frame, {results['views']} cameras, {nx} x {ny} x {nz} voxels")
    table.add_column("program")
    for heading in ("ms, median [quartiles]", "least", "x Open3D", "x NumPy"):
        table.add_column(heading, justify="right")
    for label, timing in compared(results):
        ratios = (carving.median / timing.median, twin.median / timing.median)
        shown = (f"{x:.3g}" for x in (timing.least, *ratios))
        table.add_row(label, str(timing), *shown)
    stdout.print(table)
    for device in results["devices"]:
        for mode in ("dense", "sparse"):
            timings = device[mode]["stages"]
            ms = sum(timings[stage].median for stage in SHAPE_STAGES if stage in timings)
            stdout.print(
                f"{device['label']}, {mode}: silhouette maps to surface {ms:.3g} ms on the device, "
                f"{carving.median / ms:.3g} x Open3D's carving, {twin.median / ms:.3g} x the twin",
                soft_wrap=True,
            )
    left, ours = results["open3d"]["voxels_left"], results["open3d"]["voxels_of_ours"]
    stdout.print(
        f"Open3D keeps {left:,} voxels (any of 8 corners in the mask), the centre test {ours:,}"
    )


def _print_stages(device: dict[str, Any], mode: str) -> None:
    limits = device["limits"]
    table = Table(
        title=f"{device['label']}, {mode}: device time by stage; at best "
        f"{limits.bytes / 1e9:,.0f} GB/s, {limits.flops / 1e9:,.0f} GFLOP/s (measured)"
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
        ratios = (
            single[mode]["whole"].median / device[mode]["whole"].median
            for mode in ("dense", "sparse")
        )
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


def plot(results: dict[str, Any], path: Path) -> None:
    """Whole frames, stages, and growth with voxels and cameras."""
    figure, axes = plt.subplots(2, 2, figsize=(15, 10), layout="constrained")
    _plot_comparison(axes[0, 0], results)
    _plot_stages(axes[0, 1], results["devices"])
    _plot_growth(axes[1, 0], results, "voxels")
    _plot_growth(axes[1, 1], results, "views")
    with written_whole(path) as temporary:
        figure.savefig(temporary, dpi=110, format="png")
    plt.close(figure)
    stdout.print(f"wrote {path} and {path.with_suffix('.json')}", soft_wrap=True)


def _plot_comparison(axes: Any, results: dict[str, Any]) -> None:
    rows = [(k, v) for k, v in compared(results) if "masks" not in k and "streamed" not in k][::-1]
    medians = [timing.median for _, timing in rows]
    spread = [
        [t.median - t.low for _, t in rows],
        [t.high - t.median for _, t in rows],
    ]
    ours = ["#4c78a8" if ", dense" in k or ", sparse" in k else "#9aa5b1" for k, _ in rows]
    axes.barh([label for label, _ in rows], medians, xerr=spread, color=ours)
    for y, median in enumerate(medians):
        axes.text(median * 1.1, y, f"{median:.3g} ms", va="center", fontsize=8)
    axes.set_xscale("log")
    axes.set_xlim(min(medians) / 3, max(medians) * 5)
    axes.tick_params(axis="y", labelsize=8)
    axes.set_xlabel("ms per frame (lower is better)")
    axes.set_title("One frame")


def _plot_stages(axes: Any, devices: list[dict[str, Any]]) -> None:
    labels = [f"{d['label']}\n{mode}" for d in devices for mode in ("dense", "sparse")]
    left = [0.0] * len(labels)
    for stage, colour in zip(STAGES, _COLOURS, strict=True):
        values = [
            d[mode]["stages"][stage].median if stage in d[mode]["stages"] else 0.0
            for d in devices
            for mode in ("dense", "sparse")
        ]
        axes.barh(labels, values, left=left, color=colour, label=stage)
        left = [a + b for a, b in zip(left, values, strict=True)]
    axes.invert_yaxis()
    axes.tick_params(axis="y", labelsize=8)
    axes.set_xlabel("ms on the device")
    axes.set_title("By stage")
    axes.legend(fontsize=8)


def _plot_growth(axes: Any, results: dict[str, Any], what: str) -> None:
    fixed = {"voxels": ("views", results["views"]), "views": ("shape", tuple(results["shape"]))}
    key, value = fixed[what]
    kept = [row for row in results["growth"] if row[key] == value]
    for label in dict.fromkeys((row["label"], row["mode"]) for row in kept):
        mine = sorted(
            (row[what], row["ms"].median) for row in kept if (row["label"], row["mode"]) == label
        )
        style = "o-" if label[1] == "dense" else "s--"
        axes.plot(*zip(*mine, strict=True), style, label=", ".join(label))
    if what == "voxels":
        axes.set_xscale("log")
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0)
    axes.set_xlabel({"voxels": "voxels of the grid", "views": "cameras"}[what])
    axes.set_ylabel("ms per frame")
    axes.set_title(f"Growth with {'voxels' if what == 'voxels' else 'cameras'}")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
