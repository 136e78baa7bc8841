"""Report the speed of a live run: the expected one before it, and the actual one during it."""

from __future__ import annotations

import time
from collections.abc import Callable

from apf.live.session import Live, LiveResult
from apf.live.timeline import Timeline

#: Interval, s, between two lines without a terminal; number of latest poses that rate and latency
#: are averaged over.
EVERY, _RECENT = 5.0, 30
#: Share of the wanted rate below which a run does not keep up.
_SLOW = 0.9


def expect_pace(live: Live, wanted: float) -> tuple[bool, str]:
    """Return whether a run will track the `wanted` poses per second, by the times measured before
    it, and a line on that; if not, with advice, most helpful first."""
    rate, processing = live.expected_rate, live.processing_time
    searching = float(live.governor.costs[live.governor.chosen])
    text = (
        f"about {rate:.1f} poses per second can be found of the {wanted:g} wanted: "
        f"{1000 * processing:.0f} ms for a frame's pictures at {live.scale:g} of their size, "
        f"{1000 * searching:.0f} ms for its search"
    )
    if rate >= _SLOW * wanted:
        return True, text
    smaller = f"smaller pictures (--scale {live.scale / 2:g})"
    search = "a smaller search (--particles, --layers)"
    first = ", ".join((smaller, search) if processing > searching else (search, smaller))
    return False, f"{text}; faster with {first}, fewer cameras or a GPU; frames are dropped"


class PaceReporter:
    """Reports the progress of a run: `progress(result, timeline)`, as `Live.run` calls it.

    show: receives a line at every call, which replaces the one before. say: receives a line to
    keep, every `EVERY` s. One of them may be None. warn: receives one warning when the run falls
    behind `wanted` poses per second; None if the user was warned before the run.
    """

    def __init__(
        self,
        wanted: float,
        show: Callable[[str], object] | None,
        say: Callable[[str], object] | None,
        warn: Callable[[str], object] | None,
    ) -> None:
        self._wanted, self._show, self._say, self._warn = wanted, show, say, warn
        self._began = self._last_line = time.monotonic()

    def __call__(self, result: LiveResult, timeline: Timeline) -> None:
        now = time.monotonic()
        if self._show is not None:
            self._show(describe_run(result, timeline))
        if now - self._last_line < EVERY:
            return
        self._last_line = now
        if self._say is not None:
            self._say(f"{now - self._began:.0f} s: {describe_run(result, timeline)}")
        rate = _rate(timeline)
        if self._warn is not None and rate < _SLOW * self._wanted:
            self._warn(f"{rate:.1f} poses per second are found of the {self._wanted:g} wanted")
            self._warn = None


def describe_run(result: LiveResult, timeline: Timeline) -> str:
    """Return one line on the progress of a run."""
    if not result.frames:
        return "no pose yet"
    latency = 1000 * timeline.latencies()[-_RECENT:].mean()
    _, particles, layers = result.sizes[-1]
    n_lost = sum(estimate.lost for estimate in result.newest)
    lost = f"; {n_lost} of {len(result.newest)} LOST" if n_lost else ""
    if len(result.newest) == 1 and n_lost:
        lost = "; LOST"
    return (
        f"{len(result.frames)} poses, {_rate(timeline):.1f} per second, latency {latency:.0f} ms, "
        f"{sum(timeline.dropped.values())} frames dropped, {particles} x {layers}{lost}"
    )


def _rate(timeline: Timeline) -> float:
    intervals = timeline.intervals()[-_RECENT:]
    return float(1 / intervals.mean()) if intervals.size else 0.0
