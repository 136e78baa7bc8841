"""The plot of an `Evaluation`: error over time, and per joint."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from apf.body.model import find_side, plain_name
from apf.evaluation.evaluate import LOST_JOINT, Evaluation
from psfs.common.files import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Colours of left limbs, right limbs, trunk and head, also used by the overlay: the blue, vermilion
#: and green of Okabe and Ito, which colour-blind readers can distinguish.
SIDE_COLOURS = {"left": "#0072B2", "right": "#D55E00", "middle": "#009E73"}
_INK, _FAINT = "#222222", "#8A8A8A"
_SIDES = {"left": "left joints", "right": "right joints", "middle": "trunk and head"}


def write_plot(path: str | Path, evaluation: Evaluation, title: str = "") -> None:
    """Write a PNG with the mean error per frame, the errors of single joints, and a bar per joint,
    mm."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 7.6), layout="constrained")
    over_time, per_joint = figure.subplots(2, 1, height_ratios=[1.15, 1])
    _plot_frames(over_time, evaluation)
    _plot_joints(per_joint, evaluation)
    for axes in (over_time, per_joint):
        axes.set_ylabel("error, mm")
        axes.grid(axis="y", color="#DDDDDD")
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(title, fontweight="bold")
    with write_atomically(path) as temporary:
        figure.savefig(temporary, dpi=130, format="png")


def _plot_frames(axes: Axes, evaluation: Evaluation) -> None:
    errors = 1000 * evaluation.errors
    frames, mean = evaluation.frames, 1000 * evaluation.frame_errors
    marker = "o" if len(frames) < 12 else None
    labels = dict(_SIDES)
    for name, values in zip(evaluation.joint_names, errors.T, strict=True):
        side = find_side(name)
        axes.plot(
            frames, values, color=SIDE_COLOURS[side], lw=0.7, alpha=0.45, marker=marker, ms=2,
            label=labels.pop(side, None),
        )  # fmt: skip
    axes.plot(frames, mean, color=_INK, lw=2.2, marker=marker, ms=4, label="mean of the joints")
    # The scale follows the joints, but one outlier must not flatten all the others.
    top = max(np.nanpercentile(errors, 99.5) * 1.2, 1.6 * mean.max(), 10.0)
    axes.set_ylim(0, top)
    lost = 1000 * LOST_JOINT
    if top > lost:
        axes.axhline(lost, color=_FAINT, ls="--", label=f"lost: beyond {lost:.0f} mm")
    for name, values in zip(evaluation.joint_names, errors.T, strict=True):
        worst = int(np.nanargmax(values))
        if values[worst] > lost:  # each lost joint is named at its worst frame
            place = frames[worst], min(values[worst], 0.97 * top)
            side = "right" if worst > 0.9 * len(values) else "left"
            colour = SIDE_COLOURS[find_side(name)]
            axes.annotate(plain_name(name), place, ha=side, fontsize=8, color=colour)
    above = int(np.sum(errors[np.isfinite(errors)] > top))
    note = f"; {above} joint-frames above the scale" if above else ""
    axes.set_title(f"Distance to the truth per frame (mean {mean.mean():.1f} mm{note})", loc="left")
    axes.set_xlabel(f"frame ({evaluation.fps:g} per second)")
    axes.legend(ncols=5, frameon=False, loc="upper left", fontsize=8.5)


def _plot_joints(axes: Axes, evaluation: Evaluation) -> None:
    """Plot a bar per joint: its mean, the constant part as a tick, the 95th percentile as a
    whisker."""
    names = evaluation.joint_names
    x = np.arange(len(names))
    mean = 1000 * np.nanmean(evaluation.errors, axis=0)
    high = 1000 * np.nanpercentile(evaluation.errors, 95, axis=0)
    constant = 1000 * evaluation.constant_and_rest[0]
    bars = axes.bar(x, mean, width=0.62, color=[SIDE_COLOURS[find_side(n)] for n in names])
    axes.bar_label(bars, fmt="%.0f", padding=2)
    axes.vlines(x, mean, high, color=_FAINT, lw=1.1, label="up to the 95th percentile")
    axes.hlines(constant, x - 0.31, x + 0.31, color=_INK, lw=1.6, label="constant part")
    axes.set_xticks(x, [plain_name(name) for name in names], rotation=30, ha="right")
    axes.set_title("Per joint (bar: mean; black tick: constant in the body's frame)", loc="left")
    axes.legend(frameon=False, loc="upper right", ncols=2, fontsize=8.5)
