"""The time line: the clock of a viewer, and a slider, buttons, keys and a thread that move it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import viser

#: Playback speeds, as multiples of real time.
SPEEDS = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
#: Longest time that one tick advances, s: a viewer that draws slowly then plays slowly instead of
#: skipping more frames.
_LONGEST_TICK = 0.1
#: Most frames per second that are sent to the page, and that the slider follows while playing.
_MOST_RATE, _SLIDER_RATE = 60.0, 5.0
_FIRST, _BACK, _AHEAD, _LAST = "first", "back", "next", "last"
_PLAY, _PAUSE = "play", "pause"


def add_key(gui: viser.GuiApi, label: str, key: Any, do: Callable[[], None]) -> Any:
    """Add a key to the page, with a label for its list of keys; return viser's handle. W, A, S, D,
    Q, E and the arrows are viser's: they move and turn the 3-D view."""
    command = gui.add_command(label, hotkey=key)
    command.on_trigger(lambda event: do())
    return command


def add_button(gui: viser.GuiApi, label: str, do: Callable[[], None], **look: Any) -> Any:
    """Add a button; return viser's handle."""
    button = gui.add_button(label, **look)
    button.on_click(lambda event: do())
    return button


class Playback:
    """A clock over the `times` (F,), s, of a run's frames.

    `position` is the index of the frame that is shown. Playback loops: the first frame follows the
    last one, which is shown as long as the one before it.
    """

    def __init__(self, times: np.ndarray) -> None:
        self.times, self.position = times, 0
        self.playing, self.speed = False, 1.0
        self._gap = float(times[-1] - times[-2]) if len(times) > 1 else 1.0
        self._clock = float(times[0])

    def seek(self, position: int) -> None:
        """Pause, and show the frame at `position`, modulo the number of frames."""
        self.playing, self.position = False, position % len(self.times)
        self._clock = float(self.times[self.position])

    def change_speed(self, by: int) -> None:
        """Move `by` entries along SPEEDS, at most to an end."""
        entry = SPEEDS.index(self.speed) + by
        self.speed = SPEEDS[min(max(entry, 0), len(SPEEDS) - 1)]

    def advance(self, seconds: float) -> None:
        """Advance the clock by `seconds` of the viewer's time."""
        if not self.playing:
            return
        first, span = self.times[0], self.times[-1] + self._gap - self.times[0]
        passed = self.speed * min(seconds, max(_LONGEST_TICK, self._gap))
        self._clock = first + (self._clock - first + passed) % span
        self.position = int(np.searchsorted(self.times, self._clock, "right")) - 1


class TimeLine(Playback):
    """The time line of a run's `frames` (F,).

    gui: viser's, in whose current folder the line is added. show: called with the position in
    `frames` of the one to show, by one thread at a time. stops: positions (n,) that the keys N and
    P go to, those to check.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        frames: np.ndarray,
        fps: float,
        show: Callable[[int], object],
        stops: Sequence[int] = (),
    ) -> None:
        super().__init__(frames / fps)
        self._show, self._stops = show, np.unique(np.asarray(stops, int))
        self._lock = threading.RLock()
        self._ended, self._wake = threading.Event(), threading.Event()
        self.slider: Any = gui.add_slider(
            "frame", 0, max(1, len(frames) - 1), 1, 0,
            hint="which frame is shown, counted from the first one of the run",
        )  # fmt: skip
        self.button: Any = gui.add_button(_PLAY, hint="key: space")
        self.buttons = gui.add_button_group(
            "go to", (_FIRST, _BACK, _AHEAD, _LAST),
            hint="keys: Home, J, L, End; N and P: next and previous frame to check",
        )  # fmt: skip
        self.speeds: Any = gui.add_dropdown(
            "speed", [f"{speed:g}" for speed in SPEEDS], initial_value="1",
            hint="times as fast as the recording; keys: Page Up, Page Down",
        )  # fmt: skip
        self.slider.on_update(self._slide)
        self.button.on_click(lambda event: self._press(_PLAY))
        self.buttons.on_click(lambda event: self._press(event.target.value))
        self.speeds.on_update(lambda event: self._set_speed(float(self.speeds.value)))
        self._commands = [add_key(gui, *key) for key in self.list_keys()]
        self._thread = threading.Thread(target=self._play, daemon=True, name="time line")
        self._thread.start()

    def list_keys(self) -> list[tuple[str, str, Callable[[], None]]]:
        """Return label, key and effect of each of the line's keys."""
        return [
            ("Play or pause", "space", lambda: self._press(_PLAY)),
            ("Next frame", "L", lambda: self._press(_AHEAD)),
            ("Previous frame", "J", lambda: self._press(_BACK)),
            ("First frame", "home", lambda: self._press(_FIRST)),
            ("Last frame", "end", lambda: self._press(_LAST)),
            ("Faster", "pageup", lambda: self.change_speed(1)),
            ("Slower", "pagedown", lambda: self.change_speed(-1)),
            ("Next frame to check", "N", lambda: self.go_to_stop(1)),
            ("Previous frame to check", "P", lambda: self.go_to_stop(-1)),
        ]

    def refresh(self) -> None:
        """Show the current frame again."""
        with self._lock:
            self._show(self.position)

    def seek(self, position: int) -> None:
        """Pause, and show the frame at a position."""
        with self._lock:
            super().seek(position)
            self._present(slider=True)

    def go_to_stop(self, way: int) -> None:
        """Show the next (1) or the previous (-1) frame to check, if there is one."""
        ahead = self._stops[self._stops > self.position]
        behind = self._stops[self._stops < self.position]
        if way > 0 and len(ahead):
            self.seek(int(ahead[0]))
        elif way < 0 and len(behind):
            self.seek(int(behind[-1]))

    def close(self) -> None:
        """End the thread, and remove what was added to the page."""
        self._ended.set()
        self._wake.set()
        self._thread.join(timeout=30)
        for part in (self.slider, self.button, self.buttons, self.speeds, *self._commands):
            part.remove()

    def _press(self, button: str) -> None:
        with self._lock:
            if button == _PLAY:
                self.playing = not self.playing
                self._name_button()
                self._wake.set()
                self._move_slider()
                return
            positions = {_FIRST: 0, _BACK: self.position - 1, _AHEAD: self.position + 1}
            self.seek(positions.get(button, -1))

    def _slide(self, event: Any) -> None:
        if event.client is not None:  # else it was moved by the clock
            with self._lock:
                if int(self.slider.value) != self.position:
                    super().seek(int(self.slider.value))
                    self._present(slider=False)

    def _set_speed(self, speed: float) -> None:
        with self._lock:
            self.speed = speed

    def change_speed(self, by: int) -> None:
        """Move `by` entries along SPEEDS, and say so."""
        with self._lock:
            super().change_speed(by)
            self.speeds.value = f"{self.speed:g}"

    def _name_button(self) -> None:
        self.button.label = _PAUSE if self.playing else _PLAY

    def _present(self, slider: bool) -> None:
        self._show(self.position)
        self._name_button()
        if slider:
            self._move_slider()

    def _move_slider(self) -> None:
        if int(self.slider.value) != self.position:
            self.slider.value = self.position

    def _play(self) -> None:
        last, slid, played = time.perf_counter(), 0.0, False
        while not self._ended.is_set():
            if not self.playing:
                if played:
                    self.refresh()  # with what was left out while it played
                played = False
                self._wake.wait()
                self._wake.clear()
                last = time.perf_counter()
                continue
            now, played = time.perf_counter(), True
            with self._lock:
                before = self.position
                self.advance(now - last)
                if self.position != before:
                    due = now - slid > 1 / _SLIDER_RATE
                    slid = now if due else slid
                    self._present(slider=due)
            last = now
            self._ended.wait(max(0.001, 1 / _MOST_RATE - (time.perf_counter() - now)))
