"""The panel that corrects a track: handles at joints, bad frames, the file, tracking again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from apf.body.model import plain_name
from apf.request import TrackRequest
from apf.studio.watch import TrackWatch
from apf.tracking.retracking import (
    REACH,
    Correction,
    Corrections,
    correct_pose,
    write_corrections,
)
from apf.tracking.track import Track
from cl import InputError, UserError
from psfs.common.requests import SETTINGS, Stated, read_config
from psfs.page.pictures import crosses, locate_point
from psfs.page.server import read_choice
from psfs.page.timeline import add_button, add_key
from psfs.page.words import make_lines, make_text

if TYPE_CHECKING:
    import viser

#: The file of corrections, beside the track that they correct.
FILE = "corrections.toml"
_DRAG, _TURN, _POINT = "dragging it", "turning its limb", "clicking it in two pictures"
_WAYS = (_DRAG, _TURN, _POINT)
_MOVE = "move this joint"
#: Joints that are corrected most.
_FIRST = ("wrist", "elbow", "hand", "ankle", "knee", "foot")
_SIZE = 0.35  # of a handle, m
_FIRST_STEP = "Go to a frame with a joint that is wrong, and choose the joint."


class CorrectPanel:
    """The panel. start: starts a request; say: shows an error on the page."""

    def __init__(
        self,
        server: viser.ViserServer,
        start: Callable[[TrackRequest], object],
        say: Callable[[object], object],
    ) -> None:
        self._server, self._start, self._say = server, start, say
        self._watch: TrackWatch | None = None
        self._handle: JointHandle | None = None
        self._rays: dict[int, np.ndarray] | None = None  # while a joint is clicked in pictures
        self._clicked = 0  # the frame of these pictures
        self._joints: dict[str, str] = {}
        self.corrections: Corrections | None = None
        gui = server.gui
        self._message = gui.add_html(make_text("Open a track to correct it."))
        self.joint: Any = gui.add_dropdown("joint", ["-"], initial_value="-")
        self.way: Any = gui.add_dropdown(
            "by", _WAYS, initial_value=_DRAG,
            hint="drag the joint, turn it about the joint before it, or click it in two pictures",
        )  # fmt: skip
        self.move_button = add_button(gui, _MOVE, self.toggle_handle, hint="key: C", disabled=True)
        self.cancel = add_button(gui, "cancel", self.put_back, visible=False)
        self.reach = gui.add_number(
            "time window, s", REACH, min=0.0, max=10.0, step=0.1,
            hint="time before and after the frame that is tracked again",
        )  # fmt: skip
        mark = "mark this frame as bad"
        self.bad = add_button(gui, mark, self.mark_bad, hint="key: B", disabled=True)
        self.undo = add_button(gui, "take back the last one", self.take_back, disabled=True)
        self.again = add_button(gui, "track again", self.track_again, disabled=True)
        self.list: Any = gui.add_html("")
        add_key(gui, "Put a joint right", "C", self.toggle_handle)
        add_key(gui, "Mark frame as bad", "B", self.mark_bad)

    def offer(self, watch: TrackWatch | None) -> None:
        """Offer to correct what is watched; None offers nothing."""
        self._remove_handle()
        self._watch, self.corrections = watch, None
        if watch is not None:
            watch.pointed = self.point
        opened = watch.opened if watch is not None else None
        able = opened is not None and opened.people == 1 and opened.sequence is not None
        for button in (self.move_button, self.bad):
            button.disabled = not able
        if opened is None or not able:
            why = "a track of one person whose footage is there"
            self._message.content = make_text(f"Open {why} to correct it.")
            self._tell()
            return
        names = sorted(opened.track.joint_names, key=plain_name)
        names.sort(key=lambda name: not any(word in name for word in _FIRST))
        self._joints = {plain_name(name): name for name in names}
        self.joint.options = list(self._joints)
        self.joint.value = self.joint.options[0]
        self.corrections = Corrections(opened.folder)
        self._message.content = make_text(_FIRST_STEP)
        self._tell()

    def toggle_handle(self) -> None:
        """Show a handle at the chosen joint, to be dragged; or take its place as a correction."""
        if self._watch is None or self.corrections is None:
            return
        if self._handle is not None:
            self.correct(self._handle.wanted)
            self._remove_handle()
            return
        row = self._find_row(self._watch)
        if row is None:
            return
        self._watch.time_line.seek(self._watch.time_line.position)  # pause
        if self.way.value == _POINT:
            self._rays, self._clicked = {}, self._watch.frame
            self.cancel.visible = True
            self._tell_pointing("")
            return
        self._add_handle(self._watch.opened.track, row)

    def put_back(self) -> None:
        """Leave the joint where it was tracked."""
        self._remove_handle()
        self._message.content = make_text(_FIRST_STEP)
        if self._watch is not None:
            self._watch.time_line.refresh()

    def _find_row(self, watch: TrackWatch) -> int | None:
        """Return the track's row of the frame that is shown; say so if it was not tracked."""
        row = next(iter(watch.opened.figures.values())).rows.get(watch.frame)
        if row is None:
            self._say(f"frame {watch.frame} was not tracked; expected one that was")
        return row

    def _add_handle(self, track: Track, row: int) -> None:
        """Show a handle at the chosen joint."""
        try:
            self._handle = JointHandle(
                self._server.scene, track, row, self._joints[read_choice(self.joint)],
                turns=self.way.value == _TURN, moved=self._preview,
            )  # fmt: skip
        except InputError as error:
            self._say(error)
            return
        self.move_button.label, self.cancel.visible = "keep the joint here", True

    def move_handle(self, position: np.ndarray) -> None:
        """Put the handle that is shown to a place (3,) m; the limb follows."""
        if self._handle is not None:
            self._handle.move(position)
            self._preview()

    def point(self, view: int, way: np.ndarray) -> None:
        """Take a click on the joint in a camera's picture, as a direction (3,); a handle appears
        where two of them meet."""
        if self._watch is None or self._rays is None:
            return
        opened, frame, sequence = self._watch.opened, self._watch.frame, self._watch.opened.sequence
        assert sequence is not None
        row = self._find_row(self._watch)
        if row is None:
            return
        if frame != self._clicked:  # the joint is elsewhere in each frame: start again
            self._remove_handle()
            self._rays, self._clicked = {}, frame
        self._rays[view] = way
        if len(self._rays) < 2:
            self._tell_pointing(f"clicked in {sequence.rig[view].name}")
            return
        place, apart = locate_point(self._rays, sequence.rig)
        if self._handle is None:
            self._add_handle(opened.track, row)
        self.move_handle(place)
        found = f"the clicks pass it by {1000 * apart:.0f} mm at most"
        if not crosses(self._rays):
            found += "; these cameras look along one line: click it in one from the side, too"
        self._tell_pointing(found)

    def correct(self, joints: Mapping[str, Correction]) -> None:
        """Add corrections of joints, by name, in place of earlier ones of the same frame."""
        assert self.corrections is not None
        new = {(point.frame, point.joint) for point in joints.values()}
        kept = [p for p in self.corrections.point if (p.frame, p.joint) not in new]
        self.corrections = replace(self.corrections, point=(*kept, *joints.values()))
        self._tell()

    def mark_bad(self) -> None:
        """Mark the frame that is shown as bad."""
        if self._watch is not None and self.corrections is not None:
            frame = self._watch.frame
            bad = tuple(dict.fromkeys((*self.corrections.bad, (frame, frame))))
            self.corrections = replace(self.corrections, bad=bad)
            self._tell()

    def take_back(self) -> None:
        """Remove the last bad frame or, without one, the last corrected joint."""
        if self.corrections is not None:
            if self.corrections.bad:
                self.corrections = replace(self.corrections, bad=self.corrections.bad[:-1])
            else:
                self.corrections = replace(self.corrections, point=self.corrections.point[:-1])
            self._tell()

    def write(self) -> Path:
        """Write the corrections beside the track; return the file."""
        assert self._watch is not None and self.corrections is not None
        path = self._watch.opened.folder / FILE
        own = replace(self.corrections, track=Path(), reach=float(self.reach.value))
        write_corrections(path, own)
        return path

    def track_again(self) -> None:
        """Write the corrections, and track again what they are about, into a new folder."""
        if self._watch is None or self.corrections is None:
            return
        try:
            path, opened = self.write(), self._watch.opened
            settings = opened.folder / SETTINGS
            if opened.sequence is None or not settings.exists():
                lacks = f"lacks its footage or {SETTINGS}; expected both"
                raise InputError(f"{opened.folder}: {lacks}")
            added = Stated({"folders": (opened.sequence.folder,), "corrections": path})
            stated = added.over(read_config(TrackRequest, settings))
            self._start(TrackRequest.from_stated(stated))
            said = f"Saved in {path}. Tab Track: tracking again, into a folder of its own."
            self._message.content = make_text(said)
        except UserError as error:
            self._say(error)

    def _preview(self) -> None:
        """Draw the body as its limb follows the handle, while the handle's frame is shown."""
        if self._watch is None or self._handle is None or self._watch.frame != self._handle.frame:
            return
        opened = self._watch.opened
        name, track = next(iter(opened.tracks.items()))
        row = opened.figures[name].rows[self._handle.frame]
        pose = correct_pose(track.its_body, track.poses[row], self._handle.wanted)
        self._watch.bodies[name].show_pose(pose)

    def _remove_handle(self) -> None:
        if self._handle is not None:
            self._handle.remove()
            self._handle = None
        self._rays = None
        self.move_button.label, self.cancel.visible = _MOVE, False

    def _tell_pointing(self, found: str) -> None:
        """Say how to point at the joint, and what the clicks so far give."""
        joint = self.joint.value
        how = f"Look through a camera (left) and click the {joint}; then through another one."
        self._message.content = make_lines([("note", text) for text in (how, found) if text])

    def _tell(self) -> None:
        found = self.corrections
        lines = found.describe() if found is not None else []
        self.undo.disabled = self.again.disabled = not lines
        self.list.content = make_lines(("note", line) for line in lines)


class JointHandle:
    """A handle for a joint of a track in one of its rows.

    turns: whether it turns the joint about the one before it, with all that hangs on it, instead of
    moving it. moved: called after a user moved it. Raises InputError if nothing is to be turned.
    """

    def __init__(
        self,
        scene: viser.SceneApi,
        track: Track,
        row: int,
        joint: str,
        *,
        turns: bool,
        moved: Callable[[], None],
    ) -> None:
        self.frame = int(track.frames[row])
        names, places = track.joint_names, track.joints[row]
        number = names.index(joint)
        at = number
        self._moved = [number]
        if turns:
            before = {int(b): int(a) for a, b in track.edges}
            if number not in before:
                raise InputError(f"nothing turns the {joint}; expected a joint of a limb")
            at = before[number]
            for parent, child in track.edges.tolist():  # parents come first
                if parent in self._moved:
                    self._moved.append(child)
        self._names = [names[number] for number in self._moved]
        self._pivot, self._offsets = places[at], places[self._moved] - places[at]
        self._node = scene.add_transform_controls(
            "/handle", scale=_SIZE, disable_axes=turns, disable_sliders=turns,
            disable_rotations=not turns, depth_test=False, position=self._pivot,
        )  # fmt: skip
        self._node.on_update(lambda event: moved())

    @property
    def wanted(self) -> dict[str, Correction]:
        """The places where the joints are to be, by name."""
        turn = trimesh.transformations.quaternion_matrix(self._node.wxyz)[:3, :3]
        places = np.asarray(self._node.position, float) + self._offsets @ turn.T
        return {
            name: Correction(self.frame, name, (float(x), float(y), float(z)))
            for name, (x, y, z) in zip(self._names, places, strict=True)
        }

    def move(self, position: np.ndarray) -> None:
        """Move the joint to a place (3,) m."""
        self._node.position = position

    def remove(self) -> None:
        """Remove the handle from the view."""
        self._node.remove()
