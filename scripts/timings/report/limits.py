"""Limits of a frame's time, and its growth: cores, rooflines, settings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from timings.report.figures import STAGE_COLOURS, apply_style, plain_numbers
from timings.report.machines import Machine, device_title
from timings.results import Results
from timings.stages import STAGES
from timings.tables.whole import median_ms, papers

#: Axes of the scaling plots.
_SCALED = {
    "shape": "voxels of the grid", "cameras": "cameras", "n_particles": "particles",
    "n_layers": "layers",
}  # fmt: skip
_MARKS = "osD^vP"
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")


def core_times(results: Results) -> list[tuple[int, float]]:
    """Return (cores, ms per frame) of the CPU's columns."""
    found = {
        section["cores"]: median_ms(section)
        for section in (*results.starting("column "), *results.starting("cores "))
        if section["kind"] == "cpu"
    }
    return sorted(found.items())


def serial_share(times: Sequence[tuple[int, float]]) -> float:
    """Fit the s of Amdahl's law T(n) = T(1) (s + (1 - s) / n), in [0, 1]."""
    cores, ms = np.array(times, float).T
    rest = 1 - 1 / cores
    slower = ms / ms[0] - 1 / cores
    return float(np.clip(np.sum(rest * slower) / np.sum(rest**2), 0, 1))


@apply_style
def amdahl(machines: Sequence[Machine]) -> Any:
    """Plot the speed-up over cores, and Amdahl's law fitted to it."""
    figure, axes = plt.subplots(figsize=(6.5, 4.4), layout="constrained")
    most = 2
    for machine, colour, mark in zip(machines, _COLOURS, _MARKS, strict=False):
        times = core_times(machine.results["whole"])
        if len(times) < 2 or times[0][0] != 1:
            continue
        share = serial_share(times)
        cores = np.array([n for n, _ in times])
        most = max(most, int(cores[-1]))
        axes.plot(cores, times[0][1] / np.array([ms for _, ms in times]), mark, color=colour,
                  label=device_title("cpu-", machine).rsplit(",", 1)[0])  # fmt: skip
        fine = np.geomspace(1, cores[-1], 60)
        axes.plot(fine, 1 / (share + (1 - share) / fine), color=colour, linewidth=1,
                  label=f"Amdahl's law, {share:.1%} serial")  # fmt: skip
    song = papers()["song2012"]["tables"]["3"]["rows"][0]
    axes.plot(
        [4], [song[2]], "*", color="#8A8A8A", markersize=11, label="Song et al.: CPU+TBB, 4 cores"
    )
    ideal = np.array([1, max(most, 4)])
    axes.plot(ideal, ideal, ":", color="#8A8A8A", label="ideal")
    axes.set_xscale("log", base=2)
    axes.set_yscale("log", base=2)
    for axis in (axes.xaxis, axes.yaxis):
        plain_numbers(axis)
    axes.set_xlabel("cores")
    axes.set_ylabel("times as fast as one core")
    axes.set_title("Whole frame over CPU cores")
    axes.legend(fontsize=9, loc="upper left")
    axes.grid(alpha=0.3)
    return figure


@apply_style
def roofline(machines: Sequence[Machine]) -> Any:
    """Plot every stage's rate of operations over its operations per byte, below the device's
    limits; None if no stages were measured."""
    found = [
        (device_title(section["label"], machine), section)
        for machine in machines
        for section in machine.results["whole"].starting("stages ")
    ]
    if not found:
        return None
    figure, all_axes = plt.subplots(
        1, len(found), figsize=(max(7.0, 4.6 * len(found)), 4.7), squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for axes, (title, section) in zip(all_axes[0], found, strict=True):
        limits = section["limits"]
        intensity = np.geomspace(0.05, 3000, 100)
        roof = np.minimum(limits.flops_per_s, limits.bytes_per_s * intensity) / 1e9
        axes.loglog(intensity, roof, color="#222222", linewidth=1.3)
        gigabytes, gigaflops = limits.bytes_per_s / 1e9, limits.flops_per_s / 1e9
        text = f"copies {gigabytes:,.0f} GB/s\nmultiply-adds {gigaflops:,.0f} GFLOP/s"
        axes.text(0.03, 0.98, text, fontsize=9, va="top", transform=axes.transAxes)
        for stage in STAGES:
            nbytes, operations = section["work"].get(stage, (0, 0))
            if not operations or stage not in section["stages"]:
                continue
            rate = operations / (section["stages"][stage].median * 1e-3) / 1e9
            axes.plot(operations / nbytes, rate, "o", color=STAGE_COLOURS[stage], markersize=8,
                      markeredgecolor="#444444", markeredgewidth=0.6, label=stage)  # fmt: skip
        axes.set_title(title, fontsize=10)
        axes.set_xlabel("operations per byte")
        axes.grid(alpha=0.25)
        axes.set_ylim(top=gigaflops * 12)
    all_axes[0][0].set_ylabel("10⁹ operations per second")
    handles, labels = all_axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=9, ncols=5, loc="outside lower center")
    return figure


@apply_style
def scaling(machines: Sequence[Machine]) -> Any:
    """Plot whole frames over voxels, cameras, particles and layers; None if they were not
    measured."""
    figure, all_axes = plt.subplots(2, 2, figsize=(10.5, 7.6), layout="constrained")
    lines: dict[str, int] = {}
    for axes, (what, label) in zip(all_axes.flat, _SCALED.items(), strict=True):
        counts: set[float] = set()
        for machine in machines:
            results = machine.results["whole"]
            for name, rows in results.sections.items():
                if not name.startswith(f"scaling {what}, "):
                    continue
                title = device_title(name.split(", ", 1)[1], machine)
                k = lines.setdefault(f"{machine.name} {title}", len(lines))
                x = [float(np.prod(row["value"])) for row in rows]
                counts.update(x)
                y = [row["frames"].median for row in rows]
                axes.plot(
                    x, y, _MARKS[k % 6] + "-", color=_COLOURS[k % 4], label=title, markersize=5
                )
        axes.set_yscale("log")
        if what == "shape":
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(FixedLocator(sorted(counts)))
            axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v / 1e6:.2g} million"))
            axes.xaxis.set_minor_locator(NullLocator())
        else:
            axes.set_xlim(left=0)
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        plain_numbers(axes.yaxis)
        axes.set_xlabel(label)
        axes.set_ylabel("ms per frame")
        axes.grid(alpha=0.3, which="both")
    if not lines:
        plt.close(figure)
        return None
    handles, labels = all_axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, ncols=3, loc="outside lower center", fontsize=9.5)
    return figure
