"""Plotly figures of a track: joint angles, and the limbs' confidence over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from apf.body.limbs import limb_names
from apf.report.curves import angle_curves
from apf.tracking.track import Track

if TYPE_CHECKING:
    import plotly.graph_objects as go

#: Colours of left, right and middle, dash by side, so that colour alone does not matter.
_LINES = {
    "left": {"color": "#0072b2"},
    "right": {"color": "#d55e00", "dash": "dash"},
    "middle": {"color": "#009e73"},
}
_MARGIN = {"l": 42, "r": 8, "t": 28, "b": 34}


def angle_groups(track: Track) -> dict[str, list[dict[str, Any]]]:
    """Return the curves of each joint by its name, see `apf.report.curves.angle_curves`."""
    return {group["name"]: group["curves"] for group in angle_curves(track)}


def draw_angles(track: Track, name: str) -> go.Figure:
    """Return the figure of one joint's angles, degrees, by frame."""
    import plotly.graph_objects as go  # slow to import

    figure = go.Figure()
    for curve in angle_groups(track)[name]:
        label = f"{curve['side']} {curve['name']}".removeprefix("middle ")
        figure.add_scatter(
            x=track.frames, y=curve["values"], name=label, line=_LINES[curve["side"]], mode="lines"
        )
    figure.update_layout(
        title=f"{name}, degrees", xaxis_title="frame", legend={"y": -0.3, "orientation": "h"}
    )
    return _small(figure)


def draw_confidence(track: Track) -> go.Figure:
    """Return the figure of the probability that each limb is right, and the confidence in the
    whole person, by frame: dark is doubtful."""
    import plotly.graph_objects as go

    rows = [*limb_names(track.its_body), "person"]
    values = np.column_stack([track.limb_confidence, np.where(track.lost, 0.0, track.confidence)])
    figure = go.Figure(
        go.Heatmap(
            x=track.frames, y=rows, z=values.T, zmin=0, zmax=1, colorscale="Cividis",
            colorbar={"thickness": 8, "title": ""},
        )
    )  # fmt: skip
    figure.update_layout(title="confidence: dark is doubtful", xaxis_title="frame")
    return _small(figure)


def _small(figure: go.Figure) -> go.Figure:
    figure.update_layout(
        margin=_MARGIN,
        font={"size": 11},
        title_font_size=12,
        template="plotly_white",
    )
    return figure
