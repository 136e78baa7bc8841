"""The state of a viewer and the effect of its keys, without a window."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from psfs.mesh.drawing import COLOURINGS, Drawing, Layer
from psfs.mesh.playback import Playback


class Player:
    """A run's frames over time (`playback`), in `layers` that can be hidden, in a `colouring`.

    note: function that returns more about a frame (its index), such as the size of its cloud.
    """

    def __init__(
        self,
        playback: Playback,
        layers: Sequence[Layer],
        note: Callable[[int], str] = lambda _frame: "",
    ) -> None:
        self.playback, self.layers, self.note = playback, tuple(layers), note
        self.colouring = COLOURINGS[0]
        self.shown = {layer.name: layer.shown for layer in self.layers}

    def drawings(self) -> dict[str, Drawing]:
        """Return the drawings to show now, by the names of their layers."""
        found = {
            layer.name: layer.drawing(self.playback.frame, self.colouring)
            for layer in self.layers
            if self.shown[layer.name]
        }
        return {name: drawing for name, drawing in found.items() if drawing is not None}

    def caption(self) -> str:
        """Return frame, time and note in one line."""
        playback = self.playback
        text = f"frame {playback.frame}   {playback.time:.2f} s   speed {playback.speed:g}"
        note = self.note(playback.frame)
        return f"{text}   {note}" if note else text

    def press(self, key: str) -> bool:
        """Perform the action of `key`, one of KEYS or a digit.

        Returns False for keys that the window handles, or nothing does.
        """
        last = len(self.playback.frames) - 1
        actions: dict[str, Callable[[], object]] = {
            "space": self.playback.toggle,
            "left": lambda: self.playback.step(-1),
            "right": lambda: self.playback.step(1),
            "home": lambda: self.playback.seek(0),
            "end": lambda: self.playback.seek(last),
            "up": lambda: self.playback.change_speed(1),
            "down": lambda: self.playback.change_speed(-1),
            "c": self._next_colouring,
        }
        for number, layer in enumerate(self.layers, 1):
            actions[str(number)] = lambda name=layer.name: self._toggle(name)  # type: ignore[misc]
        if key not in actions:
            return False
        actions[key]()
        return True

    def _next_colouring(self) -> None:
        self.colouring = COLOURINGS[(COLOURINGS.index(self.colouring) + 1) % len(COLOURINGS)]

    def _toggle(self, name: str) -> None:
        self.shown[name] = not self.shown[name]
