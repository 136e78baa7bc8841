"""The clock of a viewer: which frame of a run is shown at which time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

#: Playback speeds, as multiples of real time.
SPEEDS = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
#: Longest time that one tick advances, s: a viewer that draws slowly then plays slowly instead of
#: skipping more frames.
_LONGEST_TICK = 0.1


class Playback:
    """A clock over the `frames` of a run, indices in a sequence of `fps` frames per second.

    `position` is the index into `frames` of the one that is shown. Playback loops: the first frame
    follows the last one, which is shown as long as the one before it.
    """

    def __init__(self, frames: Sequence[int], fps: float, start: int) -> None:
        self.frames = list(frames)
        self.times = np.array(self.frames) / fps
        self.position = self.frames.index(start)
        self.playing, self.speed = False, 1.0
        self._gap = float(self.times[-1] - self.times[-2]) if len(frames) > 1 else 1 / fps
        self._clock = self.time

    @property
    def frame(self) -> int:
        """Index of the frame that is shown."""
        return self.frames[self.position]

    @property
    def time(self) -> float:
        """Time of the frame that is shown since the sequence's first frame, s."""
        return float(self.times[self.position])

    def seek(self, position: int) -> None:
        """Show the frame at `position`, modulo the number of frames."""
        self.position = position % len(self.frames)
        self._clock = self.time

    def step(self, by: int) -> None:
        """Stop playing and show the frame that lies `by` frames ahead."""
        self.playing = False
        self.seek(self.position + by)

    def toggle(self) -> None:
        """Play or pause."""
        self.playing = not self.playing

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
