"""Plotly figures of a track: joint angles, and the limbs' confidence over time."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from apf.body.limbs import limb_names
from apf.report.page import angle_curves
from apf.tracking.track import Track
from psfs.common.numbers import find_true_runs
from psfs.page.colours import CONFIDENCE

if TYPE_CHECKING:
    import plotly.graph_objects as go

#: Colours of left, right and middle, as of the body.
_SIDES = {"left": "#0072b2", "right": "#d55e00", "middle": "#009e73"}
#: Text and grid that are read on a light page and on a dark one.
_INK, _GRID = "#7d7d7d", "rgba(128,128,128,0.25)"
#: Colours that colour-blind people distinguish, and dashes.
_HUES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9")
_DASHES = ("solid", "dash", "dot", "dashdot")
_BUTTONS = ["zoom", "pan", "zoomin", "zoomout", "autoscale", "resetscale", "toimage"]
_MARGIN = {"l": 42, "r": 8, "t": 28, "b": 34}


def draw_angles(track: Track, name: str) -> go.Figure:
    """Return the figure of one joint's angles, degrees, by frame, with the area in which they
    lie."""
    import plotly.graph_objects as go  # slow to import

    figure = go.Figure()
    curves = angle_curves(track)[name]
    angles = list(dict.fromkeys(curve["name"] for curve in curves))
    for curve in curves:
        label = f"{curve['side']} {curve['name']}".removeprefix("middle ")
        line = {"color": _SIDES[curve["side"]], "dash": _DASHES[angles.index(curve["name"])]}
        values = np.array(curve["values"], float)
        half = np.array(curve["band"], float)
        for rows in find_true_runs(np.isfinite(half)):
            x = np.concatenate([track.frames[rows], track.frames[rows][::-1]])
            y = np.concatenate([(values + half)[rows], (values - half)[rows][::-1]])
            figure.add_scatter(
                x=x, y=y, fill="toself", fillcolor=f"{line['color']}22", mode="none",
                hoverinfo="skip", showlegend=False,
            )  # fmt: skip
        figure.add_scatter(x=track.frames, y=values, name=label, line=line, mode="lines")
    figure.update_layout(
        title=f"{name}, degrees", xaxis_title="frame", legend={"y": -0.3, "orientation": "h"}
    )
    return _small(figure)


def draw_confidence(track: Track) -> go.Figure:
    """Return the figure of the probability that each limb is right, and the confidence in the
    whole person, by frame: red is doubtful."""
    import plotly.graph_objects as go

    rows = [*limb_names(track.its_body), "person"]
    values = np.column_stack([track.limb_confidence, np.where(track.lost, 0.0, track.confidence)])
    figure = go.Figure(
        go.Heatmap(
            x=track.frames, y=rows, z=values.T, zmin=0, zmax=1, colorscale=CONFIDENCE,
            colorbar={"thickness": 8, "title": ""},
        )
    )  # fmt: skip
    figure.update_layout(title="confidence: red is doubtful", xaxis_title="frame")
    return _small(figure)


def draw_lags(costs: np.ndarray, names: Sequence[str]) -> go.Figure:
    """Return the figure of how far each camera's silhouettes are from the others' as a share of the
    person's size, costs (V, 2 m + 1), if its pictures came so many frames later, -m to m: a camera
    that runs with the others is lowest at 0."""
    import plotly.graph_objects as go

    figure = go.Figure()
    most = costs.shape[1] // 2
    for number, (name, cost) in enumerate(zip(names, costs, strict=True)):
        figure.add_scatter(
            x=list(range(-most, most + 1)), y=cost, name=html.escape(name), mode="lines",
            line={"color": _HUES[number % len(_HUES)], "dash": _DASHES[number % len(_DASHES)]},
        )  # fmt: skip
    figure.add_vline(0, line_color=_INK, line_width=1)
    figure.update_layout(
        title="cameras in time: lowest at 0", xaxis_title="late by, frames",
        yaxis_rangemode="tozero", legend={"y": -0.35, "orientation": "h"},
    )  # fmt: skip
    return _small(figure)


def _small(figure: go.Figure) -> go.Figure:
    figure.update_layout(
        margin=_MARGIN,
        font={"size": 11, "color": _INK},
        title_font_size=12,
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        modebar_remove=_BUTTONS,  # they would cover the title
    )
    figure.update_xaxes(gridcolor=_GRID, zeroline=False)
    figure.update_yaxes(gridcolor=_GRID, zeroline=False)
    return figure
