"""Watching a track: bodies in the 3-D view, their confidence and angles as curves."""

from __future__ import annotations

import html
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from apf.body.limbs import limb_names
from apf.report.page import angle_curves
from apf.studio.body_nodes import BodyNodes
from apf.studio.opened import OpenedTracks
from apf.tracking.track import Track
from psfs.common.numbers import find_true_runs
from psfs.page.clouds import CONFIDENCE
from psfs.page.pictures import shrink_picture
from psfs.page.watch import Watch
from psfs.sequence import Frame

if TYPE_CHECKING:
    import plotly.graph_objects as go
    import viser

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


_TRAIL_SECONDS = 1.0


class TrackWatch(Watch):
    """A run's bodies, and its voxels if there are any, on the page. Arguments as those of
    `Watch`."""

    layers = ("voxels", "body", "skeleton", "trails", "cameras")
    beside_label = "Pictures and curves"
    opened: OpenedTracks

    @cached_property
    def _lost_limbs(self) -> dict[str, np.ndarray]:
        """Each track's lost limbs, which it computes at each call."""
        return {name: track.lost_limbs for name, track in self.opened.tracks.items()}

    def _add_nodes(self, scene: viser.SceneApi) -> None:
        self.bodies = {
            name: BodyNodes(scene, f"/people/{number}", figure)
            for number, (name, figure) in enumerate(self.opened.figures.items())
        }
        super()._add_nodes(scene)
        self.voxels.filling = 0.4  # the body is seen between them

    def _add_pictures(self, gui: viser.GuiApi) -> None:
        super()._add_pictures(gui)
        tracks = {name: track for name, track in self.opened.tracks.items() if len(track) > 1}
        if not tracks:
            return
        first = next(iter(tracks))
        person = gui.add_dropdown(
            "curves of", list(tracks), initial_value=first, visible=len(tracks) > 1
        )
        self._parts.append(person)
        if names := list(angle_curves(tracks[first])):
            chosen = gui.add_dropdown("angles", names, initial_value=names[0])
            curves = gui.add_plotly(draw_angles(tracks[first], names[0]), aspect=1.1)

            def draw(event: object) -> None:
                curves.figure = draw_angles(tracks[person.value], chosen.value)

            chosen.on_update(draw)
            person.on_update(draw)
            self._parts += [chosen, curves]
        confidence = gui.add_plotly(draw_confidence(tracks[first]), aspect=1.0)
        person.on_update(
            lambda event: setattr(confidence, "figure", draw_confidence(tracks[person.value]))
        )
        self._parts.append(confidence)

    def _find_stops(self) -> Sequence[int]:
        places = {frame: position for position, frame in enumerate(self.opened.frames.tolist())}
        to_check = [frame for rows in self.opened.look_at.values() for frame in rows.tolist()]
        return [places[frame] for frame in to_check if frame in places]

    def _show_frame(self, frame: int) -> None:
        super()._show_frame(frame)
        for body in self.bodies.values():
            row = body.figure.rows.get(frame)
            body.set_visible(row is not None)
            if row is not None:
                body.show(row, int(_TRAIL_SECONDS * self.opened.fps))

    def _describe_frame(self, frame: int) -> list[tuple[str, object]]:
        opened, lines = self.opened, list[tuple[str, object]]()
        for name, track in opened.tracks.items():
            row = opened.figures[name].rows.get(frame)
            whose = f"{name}: " if len(opened.tracks) > 1 else ""
            if row is None:
                lines.append(("note", f"{whose}not tracked in this frame"))
            elif track.lost[row]:
                lines.append(("warning", f"{whose}the person is lost"))
            else:
                lost = self._lost_limbs[name][row]
                gone = [n for n, of in zip(limb_names(track.its_body), lost, strict=True) if of]
                sure = track.confidence[row]
                if np.isfinite(sure):
                    lines.append(("good" if not gone else "note", f"{whose}confidence {sure:.2f}"))
                if gone:
                    lines.append(("warning", f"{whose}doubtful: {', '.join(gone)}"))
        doubtful = [what for what, frames in opened.look_at.items() if frame in frames]
        if doubtful:
            lines.append(("warning", f"to check: {', '.join(doubtful)}"))
        return [*lines, *super()._describe_frame(frame)]

    def _list_notes(self) -> list[tuple[str, object]]:
        return [*(("note", line) for line in self.opened.quality), *super()._list_notes()]

    def _draw_picture(self, frame: Frame, view: int | None) -> np.ndarray:
        return shrink_picture(self.opened.draw(frame, view))

    def _show_layers(self, shown: dict[str, bool]) -> None:
        for body in self.bodies.values():
            for cone in body.cones:
                cone.visible = shown["body"]
            body.skeleton.visible = body.joints.visible = shown["skeleton"]
            body.with_trails = shown["trails"]
        super()._show_layers(shown)
