"""Watching a run: the 3-D view, the time line, the pictures and curves of what was opened."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from apf.body.limbs import limb_names
from apf.studio.browsers import draws_slowly
from apf.studio.clouds import CarvedClouds, Clouds
from apf.studio.curves import angle_groups, draw_angles, draw_confidence
from apf.studio.look_through import LookThrough
from apf.studio.nodes import BodyNodes, CameraNodes, VoxelNode, add_floor
from apf.studio.opened import Opened
from apf.studio.pictures import PictureReader, draw_people, small_pictures
from apf.studio.timeline import TimeLine
from apf.studio.words import make_lines, make_text
from cl import UserError
from psfs.sequence import Frame
from psfs.voxels.grid import VoxelGrid

if TYPE_CHECKING:
    import viser

_ALL, _FREE = "all cameras", "(none)"
_TRAIL_SECONDS = 1.0
#: Least time between two changes of the words while playing, s: browsers draw whole panels again.
_PAUSE = 0.2
#: A 3-D view without voxels gets a floor of this many metres around the person.
_AROUND = 1.0


class Watch:
    """A run on the page, shown until `close`.

    server: viser's. opened: see `Opened`; it is closed with this. panel: the tab of the time line.
    beside: the tab of pictures and curves.
    """

    def __init__(self, server: viser.ViserServer, opened: Opened, panel: Any, beside: Any) -> None:
        self._server, self.opened = server, opened
        self._closed, self._reader = threading.Event(), None
        self._position, self._status_time, self._timed = -1, 0.0, False
        scene = server.scene
        self.bodies = {
            name: BodyNodes(scene, f"/people/{number}", track)
            for number, (name, track) in enumerate(opened.tracks.items())
        }
        self._grid = opened.clouds.grid if opened.clouds is not None else _grid_around(opened)
        self._voxels = VoxelNode(scene, self._grid)
        add_floor(scene, self._grid)
        self._cameras, self._looking = None, None
        #: Called with a camera's index and the direction of what was clicked in its picture.
        self.pointed: Callable[[int, np.ndarray], object] = lambda view, way: None
        if opened.sequence is not None:
            rig = opened.sequence.rig
            self._cameras = CameraNodes(scene, rig)
            self._looking = LookThrough(server, rig, lambda view, way: self.pointed(view, way))
        self._look_at_scene()
        with panel:
            self._add_controls(server.gui)
        with beside:
            self._add_pictures(server.gui)
        self._seen = [opened.tracks[name].limb_confidence for name in opened.tracks]
        self._lost_limbs = [opened.tracks[name].lost_limbs for name in opened.tracks]
        if opened.sequence is not None:
            self._reader = PictureReader(opened.sequence, self._show_pictures, self._fail)
        self.time_line.refresh()
        self._want_voxels()

    def _add_controls(self, gui: viser.GuiApi) -> None:
        opened = self.opened
        self._status = gui.add_html("")
        frames = opened.frames.tolist()
        places = {frame: position for position, frame in enumerate(frames)}
        stops = [
            places[f] for rows in opened.look_at.values() for f in rows.tolist() if f in places
        ]
        self.time_line = TimeLine(gui, opened.frames, opened.fps, self._show, stops)
        self._shown = {
            "voxels": gui.add_checkbox("voxels", opened.clouds is not None),
            "body": gui.add_checkbox("body", True),
            "skeleton": gui.add_checkbox("skeleton", True),
            "trails": gui.add_checkbox("trails", True),
            "cameras": gui.add_checkbox("cameras", True),
        }
        for name, box in self._shown.items():
            box.visible = name in ("voxels", "cameras") or bool(self.bodies)
            box.on_update(lambda event: self._choose_layers())
        self._coarse: Any = gui.add_checkbox(
            "coarse while playing", False, visible=opened.clouds is not None,
            hint="fewer, larger voxels; set by itself where the browser has no graphics chip",
        )  # fmt: skip
        self._remarks = gui.add_html(self._describe())
        self._parts: list[Any] = [self._status, self._remarks, self._coarse, *self._shown.values()]

    def _add_pictures(self, gui: viser.GuiApi) -> None:
        opened, track = self.opened, self.opened.track
        if opened.sequence is not None:
            names = [_ALL, *opened.sequence.rig.names]
            self._view = gui.add_dropdown("camera", names, initial_value=_ALL)
            self._view.on_update(lambda event: self._ask_pictures())
            self.through = gui.add_dropdown(
                "look through", (_FREE, *opened.sequence.rig.names), initial_value=_FREE,
                hint="the 3-D view as this camera has it, before its picture",
            )  # fmt: skip
            self.through.on_update(lambda event: self._look_through())
            self._parts.append(self.through)
            self._picture = gui.add_image(np.zeros((90, 160, 3), np.uint8), format="jpeg")
            self._parts += [self._view, self._picture]
        if track is not None and len(track) > 1:
            confidence = gui.add_plotly(draw_confidence(track), aspect=1.6)
            names = list(angle_groups(track))
            self._parts += [confidence]
            if names:
                chosen = gui.add_dropdown("angles", names, initial_value=names[0])
                curves = gui.add_plotly(draw_angles(track, names[0]), aspect=1.1)
                chosen.on_update(
                    lambda event: setattr(curves, "figure", draw_angles(track, chosen.value))
                )
                self._parts += [chosen, curves]

    @property
    def frame(self) -> int:
        """Number of the frame that is shown."""
        return int(self.opened.frames[self.time_line.position])

    @property
    def status(self) -> str:
        """The words about the frame that is shown, HTML."""
        return str(self._status.content)

    @property
    def remarks(self) -> str:
        """The words about the run, HTML."""
        return str(self._remarks.content)

    @property
    def coarse(self) -> bool:
        """Whether voxels are shown coarsely while playing."""
        return bool(self._coarse.value)

    def show_carved(self, frame: int) -> None:
        """Show voxels that have just become known, if they are of the frame that is shown."""
        if self._closed.is_set():
            return
        if frame == self.frame:
            self.time_line.refresh()
        elif frame % 10 == 0 or frame < 0:
            self._say_status(self.time_line.position)

    def close(self) -> None:
        """End all work in the background, and remove everything from the page."""
        self._closed.set()
        self.time_line.close()
        if self._reader is not None:
            self._reader.close()
        if self._looking is not None:
            self._looking.close()
        self.opened.close()
        for part in self._parts:
            part.remove()
        self._server.scene.reset()

    def _show(self, position: int) -> None:
        """Show a frame in 3-D, and ask for its pictures."""
        if self._closed.is_set():
            return
        opened, frame = self.opened, int(self.opened.frames[position])
        with self._server.atomic():
            if opened.clouds is not None and self._shown["voxels"].value:
                self._show_voxels(opened.clouds, frame)
            for name, body in self.bodies.items():
                row = opened.rows[name].get(frame)
                body.set_visible(row is not None)
                if row is not None:
                    body.show(row, int(_TRAIL_SECONDS * opened.fps))
        now, playing = time.monotonic(), self.time_line.playing
        if not playing or (self._position != position and now - self._status_time > _PAUSE):
            self._position, self._status_time = position, now
            self._say_status(position)
            self._ask_pictures()

    def _show_voxels(self, clouds: Clouds, frame: int) -> None:
        try:
            points = clouds.get(frame)
            if points is not None and points.blocks is not None and self.time_line.playing:
                if not self._timed:
                    self._timed = True
                    threading.Thread(target=self._time_browsers, daemon=True).start()
                points = points.blocks if self._coarse.value else points
            self._voxels.show(points)
        except UserError as error:  # a file that is gone or damaged
            self._voxels.show(None)
            self._fail(f"no voxels of frame {frame}: {error}")

    def _time_browsers(self) -> None:
        """Have voxels shown coarsely while playing if a browser draws slowly."""
        if draws_slowly(self._server) and not self._closed.is_set():
            self._coarse.value = True

    def _say_status(self, position: int) -> None:
        opened, frame = self.opened, int(self.opened.frames[position])
        lines: list[tuple[str, object]] = [("note", f"frame {frame} · {frame / opened.fps:.2f} s")]
        for number, (name, track) in enumerate(opened.tracks.items()):
            row = opened.rows[name].get(frame)
            whose = f"{name}: " if len(opened.tracks) > 1 else ""
            if row is None:
                lines.append(("note", f"{whose}not tracked in this frame"))
            elif track.lost[row]:
                lines.append(("warning", f"{whose}the person is lost"))
            else:
                lost = self._lost_limbs[number][row]
                gone = [n for n, of in zip(limb_names(track.its_body), lost, strict=True) if of]
                sure = track.confidence[row]
                if np.isfinite(sure):
                    lines.append(("good" if not gone else "note", f"{whose}confidence {sure:.2f}"))
                if gone:
                    lines.append(("warning", f"{whose}doubtful: {', '.join(gone)}"))
        doubtful = [what for what, frames in opened.look_at.items() if frame in frames]
        if doubtful:
            lines.append(("warning", f"to check: {', '.join(doubtful)}"))
        if opened.clouds is not None and (words := opened.clouds.describe()):
            lines.append(("note", words))
        self._status.content = make_lines(lines)

    def _describe(self) -> str:
        opened = self.opened
        lines: list[tuple[str, object]] = [("note", line) for line in opened.quality]
        lines += [("warning", remark) for remark in opened.remarks]
        heading = make_text(f"{opened.folder.name}: {len(opened.frames)} frames")
        return heading + make_lines(lines)

    def _choose_layers(self) -> None:
        shown = {name: bool(box.value) for name, box in self._shown.items()}
        for body in self.bodies.values():
            for cone in body.cones:
                cone.visible = shown["body"]
            body.skeleton.visible = body.joints.visible = shown["skeleton"]
            body.set_trails(shown["trails"])
        if self._cameras is not None and self._looking is not None:
            self._cameras.set_visible(shown["cameras"] and self._looking.view is None)
        self._want_voxels()
        if not shown["voxels"]:
            self._voxels.show(None)
        self.time_line.refresh()

    def _look_through(self) -> None:
        assert self._looking is not None and self.opened.sequence is not None
        names = self.opened.sequence.rig.names
        chosen = self.through.value
        self._looking.choose(names.index(chosen) if chosen in names else None)
        self._choose_layers()

    def _want_voxels(self) -> None:
        if isinstance(self.opened.clouds, CarvedClouds):
            self.opened.clouds.want(bool(self._shown["voxels"].value))

    def _ask_pictures(self) -> None:
        if self._reader is not None:
            self._reader.ask(self.frame)

    def _show_pictures(self, frame: Frame) -> None:
        assert self.opened.sequence is not None and self._cameras is not None
        if self._closed.is_set():
            return
        names = self.opened.sequence.rig.names
        view = names.index(self._view.value) if self._view.value in names else None
        self._picture.image = draw_people(frame, self.opened, view)
        self._cameras.show(small_pictures(frame, self.opened.sequence))
        if self._looking is not None:
            self._looking.show(frame)

    def _fail(self, text: str) -> None:
        if not self._closed.is_set():
            self._remarks.content = self._describe() + make_lines([("warning", text)])

    def _look_at_scene(self) -> None:
        """Set the point of view: a person's height above the floor, from the side."""
        low, high = self._grid.low, self._grid.high
        centre, size = (low + high) / 2, float(np.linalg.norm(high - low))
        camera = self._server.initial_camera
        camera.look_at = centre
        camera.position = centre + size * np.array([0.75, -1.0, 0.35])
        self._server.scene.set_up_direction("+z")


def _grid_around(opened: Opened) -> VoxelGrid:
    """Return a grid around a track without voxels."""
    joints = np.concatenate([track.joints.reshape(-1, 3) for track in opened.tracks.values()])
    low, high = np.nanmin(joints, axis=0) - _AROUND, np.nanmax(joints, axis=0) + _AROUND
    return VoxelGrid.covering(low, high, 0.02)
