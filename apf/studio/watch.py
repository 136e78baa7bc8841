"""Watching a track: bodies in the 3-D view, their confidence and angles as curves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from apf.body.limbs import limb_names
from apf.report.page import angle_curves
from apf.studio.body_nodes import BodyNodes
from apf.studio.curves import draw_angles, draw_confidence
from apf.studio.opened import OpenedTracks
from psfs.page.pictures import shrink_picture
from psfs.page.watch import Watch
from psfs.sequence import Frame

if TYPE_CHECKING:
    import viser

_TRAIL_SECONDS = 1.0


class TrackWatch(Watch):
    """A run's bodies, and its voxels if there are any, on the page. Arguments as those of
    `Watch`."""

    layers = ("voxels", "body", "skeleton", "trails", "cameras")
    beside_label = "Pictures and curves"
    opened: OpenedTracks

    def __init__(
        self,
        server: viser.ViserServer,
        opened: OpenedTracks,
        panel: Any,
        beside: Any,
        line: Any = None,
    ) -> None:
        # They are computed at each call.
        self._lost_limbs = {name: track.lost_limbs for name, track in opened.tracks.items()}
        super().__init__(server, opened, panel, beside, line)

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
            body.set_trails(shown["trails"])
        super()._show_layers(shown)
