"""The panel that corrects a track: handles at joints, bad frames, the file, tracking again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from apf.body.model import plain_name
from apf.studio.opened import Opened
from apf.studio.watch import Watch
from apf.studio.words import make_lines, make_text
from apf.tracking.correction import (
    DEFAULTS,
    Correction,
    Corrections,
    correct_pose,
    write_corrections,
)
from cl import InputError, UserError

if TYPE_CHECKING:
    import viser

#: The file of corrections, beside the track that they correct.
FILE = "corrections.toml"
#: Size of a handle, m.
_HANDLE = 0.35
_FIRST = ("wrist", "elbow", "hand", "ankle", "knee", "foot")


class CorrectPanel:
    """The panel. start: starts `apf track` with flags, for a number of frames; say: shows an error
    on the page."""

    def __init__(
        self,
        server: viser.ViserServer,
        start: Callable[[list[str], int], object],
        say: Callable[[object], object],
    ) -> None:
        self._server, self._start, self._say = server, start, say
        self._watch: Watch | None = None
        self._handle: viser.TransformControlsHandle | None = None
        self.corrections: Corrections | None = None
        gui = server.gui
        self._message = gui.add_html(make_text("Open a track to correct it."))
        self.joint: Any = gui.add_dropdown("joint", ["-"], initial_value="-")
        self.place = gui.add_button("put it right in this frame", hint="key: C", disabled=True)
        self.reach = gui.add_number(
            "reach, s", DEFAULTS.reach, min=0.0, max=10.0, step=0.1,
            hint="time before and after the frame that is tracked again",
        )  # fmt: skip
        self.bad = gui.add_button("mark this frame as bad", hint="key: B", disabled=True)
        self.undo = gui.add_button("take back the last one", disabled=True)
        self.again = gui.add_button("track again", disabled=True)
        self._list = gui.add_html("")
        self.place.on_click(lambda event: self.toggle_handle())
        self.bad.on_click(lambda event: self.mark_bad())
        self.undo.on_click(lambda event: self.take_back())
        self.again.on_click(lambda event: self.track_again())
        gui.add_command("Put a joint right", hotkey="C").on_trigger(lambda e: self.toggle_handle())
        gui.add_command("Mark frame as bad", hotkey="B").on_trigger(lambda e: self.mark_bad())

    @property
    def list(self) -> str:
        """The corrections so far, HTML."""
        return str(self._list.content)

    def offer(self, watch: Watch | None) -> None:
        """Offer to correct what is watched; None offers nothing."""
        self._remove_handle()
        self._watch, self.corrections = watch, None
        opened = watch.opened if watch is not None else None
        able = opened is not None and len(opened.tracks) == 1 and opened.sequence is not None
        for button in (self.place, self.bad):
            button.disabled = not able
        if opened is None or not able:
            why = "a track of one person whose footage is there"
            self._message.content = make_text(f"Open {why} to correct it.")
            self._tell()
            return
        assert opened.track is not None
        names = sorted(opened.track.joint_names, key=_order)
        self.joint.options = names
        self.joint.value = names[0]
        self.corrections = Corrections(opened.folder)
        self._message.content = make_text("Choose a joint, put it right, drag it to its place.")
        self._tell()

    def toggle_handle(self) -> None:
        """Show a handle at the chosen joint, to be dragged; or take its place as a correction."""
        if self._watch is None or self.corrections is None:
            return
        if self._handle is not None:
            self.correct(self.joint.value, np.asarray(self._handle.position, float))
            self._remove_handle()
            return
        opened, frame = self._watch.opened, self._watch.frame
        assert opened.track is not None
        row = next(iter(opened.rows.values())).get(frame)
        if row is None:
            self._say(f"frame {frame} was not tracked; expected one that was")
            return
        self._watch.time_line.seek(self._watch.time_line.position)  # pause
        number = opened.track.joint_names.index(self.joint.value)
        self._handle = self._server.scene.add_transform_controls(
            "/handle", scale=_HANDLE, disable_rotations=True, depth_test=False,
            position=opened.track.joints[row, number],
        )  # fmt: skip
        self._handle.on_update(lambda event: self._preview())
        self.place.label = "it is right there now"

    def move_handle(self, position: np.ndarray) -> None:
        """Put the handle that is shown to a place (3,) m; the limb follows."""
        if self._handle is not None:
            self._handle.position = position
            self._preview()

    def correct(self, joint: str, position: np.ndarray) -> None:
        """Add a correction of a joint in the frame that is shown, in place of an earlier one."""
        assert self._watch is not None and self.corrections is not None
        frame = self._watch.frame
        x, y, z = (float(value) for value in position)
        kept = [p for p in self.corrections.points if (p.frame, p.joint) != (frame, joint)]
        points = (*kept, Correction(frame, joint, (x, y, z)))
        self.corrections = replace(self.corrections, points=points)
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
                self.corrections = replace(self.corrections, points=self.corrections.points[:-1])
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
            flags = [*_flags_of_footage(self._watch.opened), "--corrections", str(self.write())]
            self._start(flags, len(self._watch.opened.frames))
        except UserError as error:
            self._say(error)

    def _preview(self) -> None:
        """Draw the body as its limb follows the handle."""
        if self._watch is None or self._handle is None:
            return
        opened = self._watch.opened
        name, track = next(iter(opened.tracks.items()))
        row = opened.rows[name][self._watch.frame]
        x, y, z = (float(value) for value in self._handle.position)
        wanted = {self.joint.value: Correction(self._watch.frame, self.joint.value, (x, y, z))}
        pose = correct_pose(track.its_body, track.poses[row], wanted)
        self._watch.bodies[name].show_pose(pose)

    def _remove_handle(self) -> None:
        if self._handle is not None:
            self._handle.remove()
            self._handle = None
        self.place.label = "put it right in this frame"

    def _tell(self) -> None:
        found = self.corrections
        lines = found.describe() if found is not None else []
        self.undo.disabled = self.again.disabled = not lines
        self._list.content = make_lines(("note", line) for line in lines)


def _flags_of_footage(opened: Opened) -> list[str]:
    """Return the flags of `apf track` that repeat the track's own settings. Raises InputError."""
    settings = opened.folder / "settings.toml"
    if opened.sequence is None or not settings.exists():
        raise InputError(f"{opened.folder}: lacks its footage or settings.toml; expected both")
    return [str(opened.sequence.folder), "--config", str(settings)]


def _order(name: str) -> tuple[bool, str]:
    """Return a key that sorts the joints that are corrected most first."""
    return not any(word in name for word in _FIRST), plain_name(name)
