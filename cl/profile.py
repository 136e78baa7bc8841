"""Named timings from OpenCL events."""

from __future__ import annotations

from array import array
from collections import defaultdict
from typing import Any

import numpy as np

from cl.errors import raise_device_errors

#: At twice this number of events the older half is converted to numbers, to bound memory.
_KEPT_EVENTS = 512


class Profile:
    """Collector of the events of named commands, which it converts to milliseconds.

    A device that is not profiled has no `Profile`, so that profiling costs it nothing.
    """

    def __init__(self) -> None:
        self._events: list[tuple[str, Any]] = []
        self._ms: dict[str, array[float]] = defaultdict(lambda: array("d"))

    def add(self, name: str, event: Any) -> None:
        """Keep the event of a command."""
        self._events.append((name, event))
        if len(self._events) >= 2 * _KEPT_EVENTS:  # the older half has finished by now
            self._measure(_KEPT_EVENTS)

    def collect(self) -> dict[str, list[float]]:
        """Return the durations, ms, of all commands so far, by name; wait for unfinished ones."""
        self._measure(len(self._events))
        return {name: list(ms) for name, ms in self._ms.items()}

    def _measure(self, count: int) -> None:
        for name, event in self._events[:count]:
            with raise_device_errors("the device", name):
                event.wait()
                self._ms[name].append((event.profile.end - event.profile.start) * 1e-6)
        del self._events[:count]

    def table(self) -> list[tuple[str, int, float, float]]:
        """Return rows (name, number of runs, median ms, total ms), largest total first."""
        rows = [
            (name, len(ms), float(np.median(ms)), float(np.sum(ms)))
            for name, ms in self.collect().items()
        ]
        return sorted(rows, key=lambda row: -row[3])

    def clear(self) -> None:
        """Forget all commands."""
        self._events.clear()
        self._ms.clear()
