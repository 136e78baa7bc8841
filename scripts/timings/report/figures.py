"""The figures of the report, plotted from results' files alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import FuncFormatter

from psfs.common.files import write_atomically
from timings.report.machines import Machine, device_title
from timings.stages import PARTS, STAGES
from timings.tables.grid import number
from timings.tables.whole import columns, is_one_core, median_ms, papers

#: Colours of Okabe and Ito, which colour-blind readers can distinguish.
_KIND = {
    "numpy": "#8A8A8A",
    "one": "#56B4E9",
    "cpu": "#0072B2",
    "gpu": "#D55E00",
    "song": "#CCBFA3",
}
_BLUES, _ORANGES = plt.colormaps["Blues"], plt.colormaps["Oranges"]
STAGE_COLOURS: dict[str, Any] = {
    **dict(zip(PARTS["reconstruction"], _BLUES(np.linspace(0.35, 0.95, 6)), strict=True)),
    "colour": "#009E73",
    **dict(zip(PARTS["tracking"], _ORANGES(np.linspace(0.3, 0.95, 5)), strict=True)),
    "download": "#999999",
    "other": "#CCCCCC",
}
_STYLE: dict[Any, Any] = {
    "font.size": 10, "axes.spines.top": False, "axes.spines.right": False,
    "axes.titlelocation": "left", "axes.titlesize": 11.5, "axes.titleweight": "bold",
    "axes.edgecolor": "#8A8A8A", "legend.frameon": False, "svg.hashsalt": "psfs-apf",
    "figure.facecolor": "white",
}  # fmt: skip


def write_figure(figure: Any, path: Path) -> None:
    """Write SVG or PNG without the date, so that the same results give the same file."""
    metadata = {"Date": None} if path.suffix == ".svg" else {"Software": None}
    with write_atomically(path) as temporary:
        figure.savefig(temporary, dpi=130, metadata=metadata, bbox_inches="tight")
    plt.close(figure)


def apply_style(draw: Callable[..., Any]) -> Callable[..., Any]:
    def drawn(*args: Any) -> Any:
        with plt.rc_context(_STYLE):
            return draw(*args)

    return drawn


@apply_style
def headline(machines: Sequence[Machine]) -> Any:
    """Plot whole frames of every column of every machine, and Song's."""
    rows: list[tuple[str, float, str] | None] = []
    for machine in machines:
        rows.append((machine.title, 0.0, ""))
        for title, column in columns(machine.results["whole"]):
            rows.append((title, median_ms(column), column_kind(column)))
        rows.append(None)
    song = papers()["song2012"]["tables"]["2"]["rows"]
    rows.append(("Song et al. 2012: Core i7 860, Radeon HD 6870", 0.0, ""))
    rows += [(name, values[-1], "song") for name, *values in song]
    figure, axes = plt.subplots(figsize=(9.5, 0.33 * len(rows) + 0.9))
    times = [row[1] for row in rows if row and row[1]]
    left = 10 ** np.floor(np.log10(min(times)) - 0.1)
    for y, row in enumerate(rows):
        if row is None:
            continue
        label, ms, kind = row
        if not ms:
            axes.text(left, y, label, va="center", weight="bold", fontsize=10)
            continue
        axes.barh(y, ms - left, left=left, color=_KIND[kind], height=0.72)
        text = f" {number(ms)} ms" + (f"  ({number(1e3 / ms)} frames/s)" if ms < 1e4 else "")
        axes.text(ms, y, text, va="center", fontsize=9.5)
    shown = [y for y, row in enumerate(rows) if row and row[1]]
    axes.set_yticks(shown, [rows[y][0].split(", NVIDIA")[0] for y in shown])  # type: ignore[index]
    axes.set_ylim(len(rows) - 0.4, -0.7)
    axes.set_xscale("log")
    axes.set_xlim(left, max(times) * 12)
    axes.tick_params(axis="y", length=0)
    plain_numbers(axes.xaxis)
    axes.set_xlabel("ms per frame, logarithmic (lower is better)")
    axes.set_title("One frame: reconstruction, colour and tracking", x=0, pad=8)
    return figure


def column_kind(column: Any) -> str:
    return "one" if is_one_core(column) else column["kind"]


def plain_numbers(axis: Any) -> None:
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}"))


@apply_style
def per_frame(machines: Sequence[Machine]) -> Any:
    """Plot the time of each frame, median over the runs: Song's table 4."""
    figure, all_axes = plt.subplots(
        1, len(machines) + 1, figsize=(4.4 * (len(machines) + 1), 4.2), sharey=True,
        layout="constrained",
    )  # fmt: skip
    for axes, machine in zip(all_axes, machines, strict=False):
        for title, column in columns(machine.results["whole"]):
            _runs_line(
                axes, title, [r["frames"].samples for r in column["runs"]], column_kind(column)
            )
        axes.set_title(machine.title.replace(" with ", "\nwith "), fontsize=10)
    song = np.array(papers()["song2012"]["tables"]["4"]["rows"], dtype=float)
    for k, (title, kind) in enumerate(
        (("CPU", "numpy"), ("CPU+TBB, 4 cores", "cpu"), ("GPU", "gpu"))
    ):
        _runs_line(all_axes[-1], title, list(song[:, 1 + 3 * k : 4 + 3 * k].T), kind)
    all_axes[-1].set_title("Song et al. 2012, table 4", fontsize=10)
    for axes in all_axes:
        axes.set_yscale("log")
        axes.set_xlim(0, 201)
        axes.set_xlabel("frame")
        axes.grid(axis="y", alpha=0.3)
        axes.legend(fontsize=8.5, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
    plain_numbers(all_axes[0].yaxis)
    all_axes[0].set_ylabel("ms")
    return figure


def _runs_line(axes: Any, title: str, runs: Sequence[Any], kind: str) -> None:
    n = max(len(run) for run in runs)
    padded = np.full((len(runs), n), np.nan)
    for row, run in zip(padded, runs, strict=True):
        row[: len(run)] = run
    style = "o-" if n < 20 else "-"
    axes.plot(np.arange(1, n + 1), np.nanmedian(padded, 0), style, color=_KIND[kind],
              linewidth=1.2, markersize=3, label=title)  # fmt: skip


@apply_style
def stages(machines: Sequence[Machine]) -> Any:
    """Plot the share of every stage in the device's time; None if no stages were measured."""
    rows = [
        (device_title(section["label"], machine), section["stages"])
        for machine in machines
        for section in machine.results["whole"].starting("stages ")
    ]
    if not rows:
        return None
    figure, axes = plt.subplots(figsize=(10, 0.62 * len(rows) + 1.9))
    totals = [sum(timing.median for timing in found.values()) for _, found in rows]
    left = np.zeros(len(rows))
    for stage in STAGES:
        shares = [
            found[stage].median / total if stage in found else 0.0
            for (_, found), total in zip(rows, totals, strict=True)
        ]
        if max(shares) == 0:
            continue
        axes.barh(range(len(rows)), shares, left=left, color=STAGE_COLOURS[stage], label=stage,
                  height=0.6)  # fmt: skip
        for y, share in enumerate(shares):
            if share > 0.045:
                shade = float(np.mean(matplotlib.colors.to_rgb(STAGE_COLOURS[stage])))
                axes.text(left[y] + share / 2, y, f"{share:.0%}", ha="center", va="center",
                          fontsize=8.5, color="white" if shade < 0.55 else "#222222")  # fmt: skip
        left += shares
    for y, total in enumerate(totals):
        axes.text(1.01, y, f"{number(total)} ms", va="center", fontsize=10)
    axes.set_yticks(range(len(rows)), [label for label, _ in rows])
    axes.invert_yaxis()
    axes.set_xlim(0, 1)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0%}"))
    axes.set_xlabel("share of the device's time for a frame, by its events")
    axes.legend(ncols=7, fontsize=8.5, loc="lower left", bbox_to_anchor=(-0.02, 1.0),
                columnspacing=1.0, handlelength=1.2)  # fmt: skip
    return figure


def part_ms(found: Any, part: str) -> float:
    """Return the time, ms, of all stages of a part together."""
    return float(sum(found[stage].median for stage in PARTS[part] if stage in found))
