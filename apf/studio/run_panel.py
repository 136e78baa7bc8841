"""The panel that starts `apf track` on the take that is open, shows its progress, and ends it.
Its fields for all settings that `apf track --config` takes are made from the settings' tree.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from functools import reduce
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any

import numpy as np

from apf.presets import PRESETS
from apf.request import TrackRequest
from apf.settings import Settings
from apf.studio.opened import RunningTake
from apf.studio.work import Work, WorkSlot, free_folder
from cl import InputError
from psfs.common.config import about, describe_range, field_choices, field_kinds, fields_below
from psfs.common.requests import Stated, nest_tables
from psfs.diagnostics.sequence_info import find_keypoints
from psfs.page.server import read_choice, read_metres
from psfs.page.timeline import add_button, add_key
from psfs.page.words import classify, make_code, make_lines, make_text
from psfs.request import frame_range
from psfs.sequence import Sequence

if TYPE_CHECKING:
    import viser

#: The nodes of the tree that `apf track` takes tables of.
_NODES = ("method", "reconstruction")
_CLOSED = "(none)"


class ChosenSettings:
    """Values of settings that differ from the defaults, by the path of names that leads to each."""

    def __init__(self) -> None:
        below = dict(fields_below(Settings))
        self.fields = {path: field for path, field in below.items() if path[0] in _NODES}
        self._defaults = Settings()
        self.values: dict[tuple[str, ...], Any] = {}

    def default(self, path: tuple[str, ...]) -> Any:
        """Return the default of a setting."""
        return reduce(getattr, path, self._defaults)

    def set(self, path: tuple[str, ...], value: Any) -> None:
        """Choose a value. Raises InputError, which says what is expected, and keeps the old one."""
        kinds = field_kinds(self.fields[path])
        if isinstance(value, str) and str not in kinds and not field_choices(self.fields[path]):
            value = _parse(value, ".".join(path))
        if isinstance(value, int) and not isinstance(value, bool) and int not in kinds:
            value = float(value)
        tried = {**self.values, path: value}
        if value == self.default(path) or (value is None and NoneType not in kinds):
            tried.pop(path)
        self._defaults.overlay(nest_tables(tried))
        self.values = tried

    @property
    def tables(self) -> dict[str, Any]:
        """The values as tables for a TOML file."""
        return nest_tables(self.values)


class SettingsPanel:
    """The fields of one group of settings at a time, in the current folder of `gui`."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self.chosen, self._gui = ChosenSettings(), gui
        self._groups: dict[str, list[tuple[str, ...]]] = {}
        for path in self.chosen.fields:
            self._groups.setdefault(".".join(path[:-1]), []).append(path)
        self._folder = gui.add_folder("all settings", expand_by_default=False)
        with self._folder:
            self._group = gui.add_dropdown("group", [_CLOSED, *self._groups], initial_value=_CLOSED)
            self._message = gui.add_html(make_text("All are at their defaults."))
        self._shown: list[Any] = []
        self._group.on_update(lambda event: self.show(self._group.value))

    def show(self, group: str) -> None:
        """Show the fields of a group in place of those that are shown."""
        for field in self._shown:
            field.remove()
        self._shown = []
        with self._folder:
            for path in self._groups.get(group, []):
                self._shown.append(self._add_field(path))

    def _add_field(self, path: tuple[str, ...]) -> Any:
        field = self.chosen.fields[path]
        value = self.chosen.values.get(path, self.chosen.default(path))
        source = about(field, "source")
        words = field.description, describe_range(field), source and f"Default: {source}."
        hint = " ".join(filter(None, words))
        kinds, choices = field_kinds(field), field_choices(field)
        if kinds == (bool,):
            control: Any = self._gui.add_checkbox(path[-1], bool(value), hint=hint)
        elif choices:
            names = [str(choice) for choice in choices]
            control = self._gui.add_dropdown(path[-1], names, initial_value=str(value), hint=hint)
        else:
            text = value if isinstance(value, str) else json.dumps(value, default=list)
            control = self._gui.add_text(path[-1], text, hint=hint)
        control.on_update(lambda event: self._change(path, control.value))
        return control

    def _change(self, path: tuple[str, ...], value: Any) -> None:
        try:
            self.chosen.set(path, value)
        except InputError as error:
            self._message.content = make_lines([("warning", error)])
            return
        lines = [f"{'.'.join(p)} = {value}" for p, value in self.chosen.values.items()]
        self._message.content = make_lines(("note", line) for line in lines) or make_text("")


def _parse(text: str, name: str) -> Any:
    """Return the value of a text as JSON. Raises InputError."""
    try:
        return json.loads(text)
    except ValueError:
        raise InputError(f"{name} is {text!r}; expected a number, a list or null") from None


#: What fields say before anything is stated.
_OURS, _ALL, _UNKNOWN = "default", "all", "not known"
#: Factor by which the track of a run must have grown to be shown again.
_LONGER = 1.5


class RunPanel:
    """The panel. results: the folder for runs. device: the flag --device. show: opens the folder of
    a run on the page; say: shows an error there."""

    def __init__(
        self,
        gui: viser.GuiApi,
        results: Path,
        device: str,
        show: Callable[[Path], object],
        say: Callable[[object], object],
    ) -> None:
        self._results, self._device, self._show, self._say = results, device, show, say
        self._sequence: Sequence | None = None
        self._volume: Callable[[], tuple[np.ndarray, np.ndarray] | None] = lambda: None
        self._n_shown = 0  # frames of the track so far that are shown
        self._running: RunningTake | None = None  # of the run that was started last
        self._message = gui.add_html(make_text("Open footage to track it."))
        self.slot = WorkSlot(gui)
        self._status = gui.add_html("")
        self.preset = gui.add_dropdown(
            "preset", [_OURS, *PRESETS], initial_value=_OURS, hint="a paper's whole system"
        )
        self.frames = gui.add_text("frames", _ALL, hint="or a:b, counted from 0, b excluded")
        self.height = gui.add_text("height, m", _UNKNOWN, hint="of the person")
        self.people = gui.add_dropdown("people", ["auto", "1", "2", "3", "4"], initial_value="auto")
        self.fast = gui.add_checkbox(
            "forward only", False, hint="half of the time, less accurate (--one-way)"
        )
        self.keypoints = gui.add_checkbox("use keypoints", False, visible=False)
        self.start_button = add_button(gui, "track", self.press_track, disabled=True, hint="key: T")
        self.settings = SettingsPanel(gui)
        add_key(gui, "Track the footage", "T", self.press_track)

    @property
    def work(self) -> Work | None:
        """The run that was started last."""
        return self.slot.work

    def offer(
        self,
        sequence: Sequence | None,
        volume: Callable[[], tuple[np.ndarray, np.ndarray] | None] = lambda: None,
    ) -> None:
        """Offer to track a sequence, with the volume that the page states; None offers nothing."""
        self._sequence, self._volume = sequence, volume
        self.start_button.disabled = sequence is None or self.slot.busy
        if sequence is None:
            words = "" if self.work is not None else "Open footage to track it."
            self._message.content = make_text(words)
            return
        self._message.content = make_text(f"{sequence.folder.name}: {len(sequence)} frames")
        self.keypoints.visible = find_keypoints(sequence.folder) is not None

    def make_request(self) -> TrackRequest:
        """Return the request that the panel states. Raises InputError."""
        assert self._sequence is not None
        capture, people = self._sequence.settings, read_choice(self.people)
        preset, box = read_choice(self.preset), self._volume()
        frames, height = self.frames.value.strip(), self.height.value.strip()
        metres = [] if height == _UNKNOWN else read_metres(self.height, "height")
        found = find_keypoints(self._sequence.folder) if self.keypoints.value else None
        stated: dict[str, Any] = {
            "folders": (self._sequence.folder,),
            "device": self._device,
            "people": people if people == "auto" else int(people),
            "preset": None if preset == _OURS else preset,
            "frames": None if frames in ("", _ALL) else frame_range(frames),
            "height": next(iter(metres), None),
            "one_way": self.fast.value or None,
            "keypoints": None if found is None else str(found),
            "calibration": capture.calibration,
            "sync": capture.sync if isinstance(capture.sync, dict) else None,
            "volume": None if box is None else np.array(box).tolist(),
        }
        values = {name: value for name, value in stated.items() if value is not None}
        return TrackRequest.from_stated(Stated(values, self.settings.chosen.tables))

    def start(self, request: TrackRequest) -> Work:
        """Start a run into a new folder of the results. Raises InputError while another goes on."""
        output = free_folder(self._results, request.folder.resolve().name)
        own = self._sequence
        stated = request.stated.over(Stated({"output": output}))
        self._n_shown = 0
        work = self.slot.start(TrackRequest.from_stated(stated), self._follow, self._end)
        self._running = None
        if own is not None and own.folder == request.folder:
            self._running = RunningTake(own, request.reconstruction)
        self.start_button.disabled = True
        return work

    def find_running(self, output: Path) -> RunningTake | None:
        """Return what a run reads that was started here and goes on, by its folder."""
        same = self.work is not None and self.work.output.resolve() == output.resolve()
        return self._running if self.slot.busy and same else None

    def close(self) -> None:
        """End the run, if one goes on, and what shows it."""
        self.slot.close()

    def press_track(self) -> None:
        """Start a run as the panel says, if footage is open; an error is shown on the page."""
        if self._sequence is None or self.start_button.disabled:
            return
        try:
            self.start(self.make_request())
        except InputError as error:
            self._say(error)

    def _follow(self, work: Work) -> None:
        """Show a run's words, its progress, and its track so far."""
        self._tell(work)
        done = work.count_frames()
        if done > _LONGER * self._n_shown + 1:
            self._n_shown = done
            self._show(work.output)

    def _end(self, work: Work) -> None:
        if (work.output / "track.npz").exists() or self._n_shown:
            self._show(work.output)
        self._tell(work)
        self.start_button.disabled = self._sequence is None

    def _tell(self, work: Work) -> None:
        ended = [("good" if work.succeeded else "warning", work.describe())] if work.ended else []
        lines = [*ended, *(classify(line, "note") for line in work.words)]
        self._status.content = make_lines(lines) + make_code(shlex.join(work.command))
