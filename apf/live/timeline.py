"""Record of what each thread did when, and its plot (Rymut 2016, figure 6.24); errors of live poses
against the truth of their frame, and of the moment at which they are known."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from apf.evaluation.evaluate import evaluate
from apf.formats.trc import JointSeries
from apf.tracking.track import Track
from psfs.common.files import write_atomically
from psfs.common.numbers import json_number

#: Number of spans, drops and latencies that are kept: some minutes.
_KEPT = 50_000
_WIDTH_S, _COLOURS = 1.0, ("#4c78a8", "#f58518", "#54a24b", "#b279a2", "#e45756", "#72b7b2")


@dataclass(frozen=True)
class Span:
    """Work of `stage` on frame `frame` from `start` to `end`, s of the run's clock."""

    stage: str
    frame: int
    start: float
    end: float


class Timeline:
    """Collects spans, dropped frames and latencies of several threads; its clock starts at 0."""

    def __init__(self, stages: tuple[str, ...]) -> None:
        self.stages = stages
        self._origin = time.perf_counter()
        self._lock = threading.Lock()
        self._spans: deque[Span] = deque(maxlen=_KEPT)
        self._dropped: deque[tuple[str, int, float]] = deque(maxlen=_KEPT)
        self._results: deque[tuple[int, float, float]] = deque(maxlen=_KEPT)
        self._n_dropped = dict.fromkeys(stages, 0)
        self._n_results = 0

    def now(self) -> float:
        """Return the time, s, since the start."""
        return time.perf_counter() - self._origin

    def add(self, span: Span) -> None:
        """Record a span."""
        with self._lock:
            self._spans.append(span)

    def drop(self, stage: str, frame: int) -> None:
        """Record that `frame` was superseded before `stage` took it."""
        with self._lock:
            self._n_dropped[stage] += 1
            self._dropped.append((stage, frame, self.now()))

    def add_result(self, frame: int, appeared: float, known: float) -> None:
        """Record that the pose of a frame that appeared at `appeared` was known at `known`, s."""
        with self._lock:
            self._results.append((frame, appeared, known))
            self._n_results += 1

    @property
    def spans(self) -> list[Span]:
        """The spans of all stages, in the order in which they ended."""
        with self._lock:
            return list(self._spans)

    @property
    def dropped(self) -> dict[str, int]:
        """Number of frames dropped before each stage."""
        with self._lock:
            return dict(self._n_dropped)

    def latencies(self) -> np.ndarray:
        """Return the latencies (R,), s, from a frame's appearance to its pose."""
        with self._lock:
            return np.array([end - start for _, start, end in self._results])

    def intervals(self) -> np.ndarray:
        """Return the intervals (R - 1,), s, between results."""
        with self._lock:
            return np.diff([end for *_, end in self._results])

    def summary(self) -> dict[str, object]:
        """Return latency, rate, durations of the stages and dropped frames, ms, ready for JSON."""
        latencies, intervals = self.latencies(), self.intervals()
        spans = self.spans
        durations = {
            stage: np.array([s.end - s.start for s in spans if s.stage == stage])
            for stage in self.stages
        }
        return {
            "results": self._n_results,
            "fps": round(float(1 / intervals.mean()), 2) if intervals.size else None,
            "latency_ms": summarise_seconds(latencies),
            "latency_frames": (
                round(float(np.mean(latencies) / intervals.mean()), 2) if intervals.size else None
            ),
            "interval_ms": summarise_seconds(intervals),
            "stages_ms": {stage: summarise_seconds(values) for stage, values in durations.items()},
            "dropped": self.dropped,
        }

    def plot(self, path: Path) -> None:
        """Plot one second in the middle of the run, with a lane per stage.

        A frame has the same colour in all lanes and an arrow from its appearance to its pose;
        crosses are frames dropped before a stage.
        """
        import matplotlib.figure

        with self._lock:
            spans, dropped = list(self._spans), list(self._dropped)
            results = list(self._results)
        middle = results[len(results) // 2][2] if results else 0.0
        width = max(_WIDTH_S, 4 * float(np.median(self.intervals())) if len(results) > 1 else 0.0)
        low, high = middle - width / 2, middle + width / 2
        colours = {frame: _COLOURS[i % len(_COLOURS)] for i, (frame, *_) in enumerate(results)}
        figure = matplotlib.figure.Figure(figsize=(13, 1.1 + 0.75 * len(self.stages)))
        axes = figure.add_subplot()
        lanes = {stage: len(self.stages) - 1 - i for i, stage in enumerate(self.stages)}
        for span in spans:
            if span.end < low or span.start > high:
                continue
            bar = ((1000 * (span.start - low), 1000 * (span.end - span.start)),)
            colour = colours.get(span.frame, "#cccccc")
            axes.broken_barh(bar, (lanes[span.stage] - 0.3, 0.6), color=colour)
            if span.frame in colours and span.end - span.start > 0.015 * width:
                centre = 500 * (span.start + span.end - 2 * low)
                axes.text(
                    centre, lanes[span.stage], str(span.frame), ha="center", va="center",
                    fontsize=7, clip_on=True,
                )  # fmt: skip
        for stage, _, when in dropped:
            if low < when < high:
                axes.plot(1000 * (when - low), lanes[stage] + 0.4, "x", color="#888888", ms=4)
        for frame, appeared, end in results:
            if low < end < high:
                start = (1000 * (appeared - low), max(lanes.values()) + 0.3)
                stop = (1000 * (end - low), min(lanes.values()) - 0.3)
                axes.annotate(
                    "", stop, start, annotation_clip=True, zorder=3,
                    arrowprops={"arrowstyle": "->", "color": colours[frame], "alpha": 0.6},
                )  # fmt: skip
        axes.set(
            xlim=(0, 1000 * width), xlabel=f"ms from {low:.2f} s of the run",
            ylim=(-0.7, len(lanes) - 0.3), yticks=list(lanes.values()),
            yticklabels=list(lanes), title=self._title(),
        )  # fmt: skip
        figure.tight_layout()
        with write_atomically(path) as temporary:
            figure.savefig(temporary, dpi=110, format="png")

    def _title(self) -> str:
        latencies, intervals = 1000 * self.latencies(), self.intervals()
        if not intervals.size:
            return "no two results"
        return (
            f"{1 / intervals.mean():.1f} poses/s, latency {latencies.mean():.0f} ms "
            f"(95 %: {np.percentile(latencies, 95):.0f}), dropped frames "
            f"{sum(self.dropped.values())} (x); grey: frames without a pose"
        )


def summarise_seconds(seconds: np.ndarray) -> dict[str, float] | None:
    """Return mean, 95th percentile and maximum, ms."""
    if not seconds.size:
        return None
    values = (seconds.mean(), np.percentile(seconds, 95), seconds.max())
    names = ("mean", "p95", "max")
    return {name: round(1000 * float(v), 2) for name, v in zip(names, values, strict=True)}


def live_errors(track: Track, truth: JointSeries, latencies: np.ndarray) -> dict[str, float | None]:
    """Return mean errors, mm, over joints and poses.

    error_mm: against the truth of the frame, which is the error of tracking. error_when_known_mm:
    against the truth `latencies` (F,) s later, when the pose was known; poses without truth at that
    time are left out. Raises InputError as `evaluate` does.
    """
    errors = {"error_mm": evaluate(track, truth).mean_error, "error_when_known_mm": np.nan}
    when, flat = track.frames + latencies * truth.fps, truth.joints.reshape(len(truth.frames), -1)
    moved = [np.interp(when, truth.frames, column, np.nan, np.nan) for column in flat.T]
    joints = np.stack(moved, -1).reshape(len(when), *truth.joints.shape[1:])
    later = replace(truth, joints=joints, frames=np.asarray(track.frames))
    if np.isfinite(later.joints).any():
        errors["error_when_known_mm"] = evaluate(track, later).mean_error
    return {name: json_number(1000 * error, 2) for name, error in errors.items()}
