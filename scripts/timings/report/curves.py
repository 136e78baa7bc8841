"""The thesis's curves from our measurements: figures 6.9 to 6.11, 6.16, 6.17 and 6.23."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from timings.report.figures import apply_style
from timings.report.machines import Machine, device_title
from timings.tables.objective import group_sections

_MARKS = "osD^vPX*"
Panel = tuple[str, Any]


def _sections(machines: Sequence[Machine], comparison: str, prefix: str) -> list[Panel]:
    """Return (title, section) for every machine."""
    return [
        (device_title(section["label"], machine), section)
        for machine in machines
        if comparison in machine.results
        for section in machine.results[comparison].starting(prefix)
    ]


def _panels(found: Sequence[Panel], draw: Callable[[Any, Any], None], rows: int = 1) -> Any:
    """Draw every section into its own axes of a column; None without sections."""
    if not found:
        return None
    figure, axes = plt.subplots(
        rows, len(found), figsize=(max(5.5, 4.2 * len(found)), 0.6 + 3.4 * rows), squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for column, (title, section) in zip(axes.T, found, strict=True):
        draw(column, section)
        column[0].set_title(title, fontsize=10)
        for one in column:
            one.grid(alpha=0.3)
            one.set_ylim(bottom=0)
            one.legend(fontsize=8.5)
    return figure


@apply_style
def swarm(machines: Sequence[Machine]) -> Any:
    """Plot error and frames/s over particles, with a line for every number of iterations."""

    def draw(axes: Any, section: Any) -> None:
        for mark, iterations in zip(_MARKS, sorted({r["iterations"] for r in section["rows"]}),
                                    strict=False):  # fmt: skip
            rows = [row for row in section["rows"] if row["iterations"] == iterations]
            particles = [row["particles"] for row in rows]
            label = f"{iterations} iterations"
            errors = [np.mean(row["errors_mm"]) for row in rows]
            axes[0].plot(particles, errors, f"{mark}-", markersize=4, label=label)
            rates = [1e3 / row["frames"].median for row in rows]
            axes[1].plot(particles, rates, f"{mark}-", markersize=4, label=label)
        axes[0].set_ylabel("error, mm")
        axes[1].set_ylabel("frames/s")
        axes[1].set_xlabel("particles")

    return _panels(_sections(machines, "methods", "curves "), draw, rows=2)


@apply_style
def shares(machines: Sequence[Machine]) -> Any:
    """Plot the share of the objective in a frame's search over particles."""
    found: dict[str, list[Any]] = {}
    for title, section in _sections(machines, "methods", "shares "):
        found.setdefault(title, []).append(section)

    def draw(axes: Any, sections: Any) -> None:
        for mark, section in zip(_MARKS, sections, strict=False):
            rows = section["rows"]
            share = [100 * (1 - r["without"].median / r["search"].median) for r in rows]
            drawn = {"opencl": "OpenCL", "opengl": "OpenGL"}[section["renderer"]]
            axes[0].plot([r["particles"] for r in rows], share, f"{mark}-", label=f"by {drawn}")
        axes[0].set_ylabel("objective, % of the search")
        axes[0].set_xlabel("particles")

    return _panels(list(found.items()), draw)


@apply_style
def groups(machines: Sequence[Machine]) -> Any:
    """Plot the time of an evaluation in every frame by size of the counting work-groups."""
    found = [
        (f"{device_title(section['label'], machine)}, {what}", section)
        for machine in machines
        if "objective" in machine.results
        for what, section in group_sections(machine.results["objective"])
    ]

    def draw(axes: Any, section: Any) -> None:
        for row in section["rows"]:
            ms = row["frames"].samples
            axes[0].plot(np.arange(len(ms)), ms, linewidth=1.2, label=row["group"])
        axes[0].set_xlabel("frame")
        axes[0].set_ylabel("ms per evaluation")

    return _panels(found, draw)


@apply_style
def online(machines: Sequence[Machine]) -> Any:
    """Plot the error offline and online over particles."""

    def draw(axes: Any, section: Any) -> None:
        particles = [row["particles"] for row in section["rows"]]
        for mark, what in zip(_MARKS, ("offline", "online"), strict=False):
            errors = [row[f"{what}_mm"] for row in section["rows"]]
            axes[0].plot(particles, errors, f"{mark}-", markersize=4, label=what)
        axes[0].set_ylabel("error, mm")
        axes[0].set_xlabel("particles")

    return _panels(_sections(machines, "methods", "online "), draw)
