"""The plot of an `Evaluation`: error over time, and per joint."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from apf.body.model import find_side, sideless
from apf.evaluation.evaluate import LOST_JOINT, Evaluation
from psfs.common.files import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Colours of left limbs, right limbs, trunk and head, also used by the overlay: the blue, vermilion
#: and green of Okabe and Ito, which colour-blind readers can distinguish.
SIDE_COLOURS = {"left": "#0072B2", "right": "#D55E00", "middle": "#009E73"}
_INK, _FAINT = "#222222", "#8A8A8A"
_STYLE: dict[Any, Any] = {
    "font.size": 9.5,
    "axes.edgecolor": _FAINT,
    "axes.labelcolor": _INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 11,
    "xtick.color": _INK,
    "ytick.color": _INK,
}


def write_plot(path: str | Path, evaluation: Evaluation, title: str = "") -> None:
    """Write a PNG with the mean error per frame, the errors of single joints, and a bar per joint,
    mm."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(11, 7.6), layout="constrained")
        FigureCanvasAgg(figure)
        over_time, per_joint = figure.subplots(2, 1, height_ratios=[1.15, 1])
        _plot_frames(over_time, evaluation)
        _plot_joints(per_joint, evaluation)
        if title:
            figure.suptitle(title, x=0.012, ha="left", fontsize=12.5, fontweight="bold")
        with write_atomically(path) as temporary:
            figure.savefig(temporary, dpi=130)


def _plot_frames(axes: Axes, evaluation: Evaluation) -> None:
    errors = 1000 * evaluation.errors
    frames, mean = evaluation.frames, 1000 * evaluation.frame_errors
    marker = "o" if len(frames) < 12 else None
    for name, values in zip(evaluation.joint_names, errors.T, strict=True):
        colour = SIDE_COLOURS[find_side(name)]
        axes.plot(frames, values, color=colour, lw=0.7, alpha=0.45, marker=marker, ms=2)
    axes.plot(frames, mean, color=_INK, lw=2.2, marker=marker, ms=4, zorder=5)
    # The scale follows the joints, but one outlier must not flatten all the others.
    top = max(np.nanpercentile(errors, 99.5) * 1.2, 1.6 * mean.max(), 10.0)
    axes.set_ylim(0, top)
    _mark_lost(axes, top)
    _name_lost(axes, evaluation, top)
    if len(frames) > 1:
        axes.set_xlim(frames[0], frames[-1])
    else:
        axes.set_xticks(frames)
    above = int(np.sum(errors[np.isfinite(errors)] > top))
    note = f"; {above} joint-frames above the scale" if above else ""
    axes.set_title(f"Distance to the truth per frame (mean {mean.mean():.1f} mm{note})")
    axes.set_xlabel(f"frame ({evaluation.fps:g} per second)")
    axes.set_ylabel("error, mm")
    axes.grid(axis="y", color="#DDDDDD", lw=0.6)
    axes.legend(handles=_legend(), ncols=4, frameon=False, loc="upper left", fontsize=8.5)


def _name_lost(axes: Axes, evaluation: Evaluation, top: float) -> None:
    """Write the name of each lost joint at its worst frame."""
    for name, errors in zip(evaluation.joint_names, 1000 * evaluation.errors.T, strict=True):
        worst = int(np.nanargmax(errors))
        if errors[worst] > 1000 * LOST_JOINT:
            at_end = worst > 0.9 * len(errors)
            axes.annotate(
                _readable(name),
                (evaluation.frames[worst], min(errors[worst], 0.97 * top)),
                xytext=(-4 if at_end else 4, 3),
                textcoords="offset points",
                ha="right" if at_end else "left",
                fontsize=8,
                color=SIDE_COLOURS[find_side(name)],
            )


def _readable(name: str) -> str:
    prefix = {"left": "L ", "right": "R ", "middle": ""}[find_side(name)]
    return prefix + sideless(name).replace("_", " ")


def _legend() -> list[Any]:
    from matplotlib.lines import Line2D

    labels = {"left": "left joints", "right": "right joints", "middle": "trunk and head"}
    handles = [Line2D([], [], color=_INK, lw=2.2, label="mean of the joints")]
    return handles + [
        Line2D([], [], color=SIDE_COLOURS[side], lw=1.2, label=label)
        for side, label in labels.items()
    ]


def _mark_lost(axes: Axes, top: float) -> None:
    if top > 1000 * LOST_JOINT:
        axes.axhline(1000 * LOST_JOINT, color=_FAINT, lw=0.9, ls=(0, (5, 3)))
        axes.annotate(
            f"lost: beyond {1000 * LOST_JOINT:.0f} mm",
            (1, 1000 * LOST_JOINT),
            xycoords=("axes fraction", "data"),
            xytext=(-3, 2),
            textcoords="offset points",
            ha="right",
            fontsize=8,
            color=_FAINT,
        )


def _plot_joints(axes: Axes, evaluation: Evaluation) -> None:
    """Plot a bar per joint: its mean, the constant part as a tick, the 95th percentile as a
    whisker."""
    names = evaluation.joint_names
    x = np.arange(len(names))
    mean = 1000 * np.nanmean(evaluation.errors, axis=0)
    high = 1000 * np.nanpercentile(evaluation.errors, 95, axis=0)
    constant = 1000 * evaluation.constant_and_rest[0]
    axes.bar(x, mean, width=0.62, color=[SIDE_COLOURS[find_side(n)] for n in names], alpha=0.85)
    axes.vlines(x, mean, high, color=_FAINT, lw=1.1, label="up to the 95th percentile")
    axes.hlines(constant, x - 0.31, x + 0.31, color=_INK, lw=1.6, label="constant part")
    for left, value, tick in zip(x, mean, constant, strict=True):
        axes.annotate(
            f"{value:.0f}",
            (left, np.nanmax([value, tick])),
            xytext=(3, 2),
            textcoords="offset points",
            fontsize=8.5,
            color=_INK,
        )
    axes.set_xticks(x, [_readable(name) for name in names], rotation=30, ha="right")
    axes.set_ylim(0, max(1.2 * high.max(), 1.0))
    axes.set_title("Per joint (bar: mean; black tick: constant in the body's frame)")
    axes.set_ylabel("error, mm")
    axes.grid(axis="y", color="#DDDDDD", lw=0.6)
    axes.set_axisbelow(True)
    axes.legend(frameon=False, loc="upper right", ncols=2, fontsize=8.5)
