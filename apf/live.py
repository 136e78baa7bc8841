"""Tracking as it happens: acquisition, image processing and tracking in threads of their own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from apf.body import BodyModel
from apf.config import SIGMA_FPS
from apf.live_budget import Cost, Governor, evaluations, sized
from apf.live_sources import ACQUISITION, Newest, Shot, Source
from apf.live_timeline import Timeline
from apf.methods import Method, observer_of, tracker_of
from apf.tracker import Estimate
from cl import Device
from psfs.grid import VoxelGrid

PROCESSING, TRACKING = "processing", "tracking"
STAGES = (ACQUISITION, PROCESSING, TRACKING)

#: A pose is searched for as widely as the time since the last one asks for, up to this, s.
_LONGEST_GAP = 0.25
#: An error of image objectives (1 is no overlap at all) beyond which a pose is not believed.
_NOTHING_SEEN = 0.9
#: Evaluations of the searches whose time gives the cost of one.
_PROBES = (960, 3000)
#: How much earlier than needed the processing begins, as a share of what it takes.
_EARLY = 0.25
#: Weight of the newest in the running means of durations.
_SMOOTH = 0.2


@dataclass
class LiveResult:
    """frames: indices with a pose. estimates: theirs. sizes: (frame, particles, layers) from which
    on a search of that size was used."""

    frames: list[int] = field(default_factory=list)
    estimates: list[Estimate] = field(default_factory=list)
    sizes: list[tuple[int, int, int]] = field(default_factory=list)


class Live:
    """Tracks `body` from `pose` (D,) through what `source` delivers.

    Three threads hand over the newest frame and drop the older ones. The processing of a frame
    (features, or voxels) begins when the tracker is free, so that no frame waits or is worked on in
    vain; a GPU, which leaves the host's cores idle, gets the next frame just in time for the
    tracker to be free when it ends. `budget`: frames per second to be reached, for which the size
    of the search is chosen and adapted; None keeps that of `method`.
    """

    def __init__(
        self,
        device: Device,
        source: Source,
        grid: VoxelGrid | None,
        body: BodyModel,
        pose: np.ndarray,
        method: Method,
        budget: float | None,
    ) -> None:
        self.device, self.source, self.body = device, source, body
        self.timeline = Timeline(STAGES)
        self.result = LiveResult()
        self._grid, self._method, self._pose = grid, method, pose
        self._overlaps = device.is_gpu
        self._processor = device.sibling()
        self._observe = observer_of(self._processor, source, grid, method)
        self._shots = Newest(lambda shot: self.timeline.drop(PROCESSING, shot.frame.index))
        self._ready = Newest(lambda pair: self.timeline.drop(TRACKING, pair[0].frame.index))
        self._free, self._stop = threading.Event(), threading.Event()
        self._free.set()
        self._errors: list[BaseException] = []
        self._free_at, self._processing_time, self._tracking_time = 0.0, 0.0, 0.0
        self._governor = self._prepared(budget)
        self._tracker = self._started(self._method)

    def run(self, progress: Callable[[LiveResult, Timeline], object] | None = None) -> LiveResult:
        """Track until the source ends, or `stop`, or KeyboardInterrupt, which ends it just so.

        Raises what a thread raised.
        """
        work = (self._acquire, self._process, self._track)
        threads = [
            threading.Thread(target=self._guarded, args=(part,), name=stage, daemon=True)
            for part, stage in zip(work, STAGES, strict=True)
        ]
        self.timeline = Timeline(STAGES)
        for thread in threads:
            thread.start()
        try:
            while threads[-1].is_alive():
                threads[-1].join(0.1)
                if progress is not None:
                    progress(self.result, self.timeline)
        except KeyboardInterrupt:
            pass
        finally:
            self.stop()
            for thread in threads:
                thread.join()
        if self._errors:
            raise self._errors[0]
        return self.result

    def stop(self) -> None:
        """End after what is under way."""
        self._stop.set()
        self._shots.close()
        self._ready.close()
        self._free.set()

    # Threads --------------------------------------------------------------------------------

    def _guarded(self, part: Callable[[], None]) -> None:
        try:
            part()
        except BaseException as error:  # handed to the caller of `run`, whatever it is
            self._errors.append(error)
            self.stop()

    def _acquire(self) -> None:
        self.source.run(self._shots, self.timeline, self._stop)
        self._shots.close()

    def _process(self) -> None:
        while not self._stop.is_set():
            self._free.wait()
            if self._overlaps:
                begin = self._free_at - (1 + _EARLY) * self._processing_time
                self._stop.wait(max(0.0, begin - self.timeline.now()))
            shot = self._shots.take()
            if shot is None:
                break
            self._free.clear()
            start = self.timeline.now()
            with self.timeline.span(PROCESSING, shot.frame.index):
                observation = self._observe(shot.frame)
                self._processor.finish()
            self._processing_time = _smoothed(self._processing_time, self.timeline.now() - start)
            self._ready.put((shot, observation))
        self._ready.close()

    def _track(self) -> None:
        last: Shot | None = None
        while (pair := self._ready.take()) is not None:
            shot, observation = pair
            start = self.timeline.now()
            self._free_at = start + self._tracking_time
            with self.timeline.span(TRACKING, shot.frame.index):
                gap = 1 / self.source.fps if last is None else shot.time - last.time
                self._tracker.widen(SIGMA_FPS * min(gap, _LONGEST_GAP))
                self._tracker.observe(observation)
                self.device.finish()
                if self._overlaps:  # the tracker has what it needs of the observation
                    self._free.set()
                estimate = self._tracker.search()
            self._free.set()
            self._keep(estimate)
            seconds = self.timeline.now() - start
            self.timeline.result(shot.frame.index, shot.time)
            self.result.frames.append(shot.frame.index)
            self.result.estimates.append(estimate)
            self._tracking_time, last = _smoothed(self._tracking_time, seconds), shot
            self._resize(seconds if self._overlaps else seconds + self._processing_time)

    # The search's size ----------------------------------------------------------------------

    def _prepared(self, budget: float | None) -> Governor | None:
        """Compiles, and with a budget measures what a search costs and sizes it."""
        frame = self.source.first()
        observation = self._observe(frame)
        self._processor.finish()
        start = time.perf_counter()
        observation = self._observe(frame)
        self._processor.finish()
        self._processing_time = time.perf_counter() - start
        if budget is None:
            self._tracking_time = self._cost_of(self._method, observation)
            return None
        probes = [sized(self._method, count) for count in _PROBES]
        seconds = [self._cost_of(probe, observation) for probe in probes]
        counts = [evaluations(probe) for probe in probes]
        cost = Cost.of((counts[0], counts[1]), (seconds[0], seconds[1]))
        if not self._overlaps:
            cost = replace(cost, fixed=cost.fixed + self._processing_time)
        governor = Governor(1 / budget, cost)
        self._method = governor.plan(self._method)
        self._tracking_time = cost.each * evaluations(self._method)
        return governor

    def _cost_of(self, method: Method, observation: Any) -> float:
        """s that a search takes, the best of three after one to compile."""
        tracker = self._tracker_of(method, self._pose)
        seconds = []
        for _ in range(4):
            start = time.perf_counter()
            tracker.step(observation)
            seconds.append(time.perf_counter() - start)
        return min(seconds[1:])

    def _keep(self, estimate: Estimate) -> None:
        """Remember a pose that fits; go back to the last such one where nothing does, instead of
        wandering off."""
        if self._method.uses_voxels or estimate.least_error[-1] < _NOTHING_SEEN:
            self._pose = estimate.pose
        else:
            self._tracker.start(self._pose)

    def _resize(self, seconds: float) -> None:
        if self._governor is None:
            return
        other = self._governor.revised(self._method, seconds)
        if other is not None:
            self._method = other
            self._tracker = self._started(other)

    def _started(self, method: Method) -> Any:
        frame = self.result.frames[-1] if self.result.frames else -1
        search = method.filter
        self.result.sizes.append((frame + 1, search.n_particles, search.n_layers))
        return self._tracker_of(method, self._pose)

    def _tracker_of(self, method: Method, pose: np.ndarray) -> Any:
        tracker = tracker_of(self.device, self.body, self.source.rig, self._grid, method)
        tracker.start(pose)
        return tracker


def _smoothed(mean: float, value: float) -> float:
    return mean + _SMOOTH * (value - mean)
