"""Live tracking: acquisition, image processing and tracking in separate threads."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from apf.body.model import BodyModel
from apf.filters.base import Estimate
from apf.filters.method import Method
from apf.live.budget import Governor
from apf.live.config import LiveConfig
from apf.live.observing import Observer, Seen, VoxelObserver, observe_features
from apf.live.person import LivePerson
from apf.live.pictures import Smaller
from apf.live.sources import ACQUISITION, Newest, Shot, Source
from apf.live.timeline import Timeline
from apf.scene import Scene
from cl import Device
from cl.batch import Batch
from psfs.people.separation import with_hidden_maps
from psfs.voxels.grid import VoxelGrid

PROCESSING, TRACKING = "processing", "tracking"
STAGES = (ACQUISITION, PROCESSING, TRACKING)


@dataclass(frozen=True, eq=False)
class ObservedFrame:
    """A frame as the tracker of each person observes it."""

    shot: Shot
    seen: list[Seen]


@dataclass
class LiveResult:
    """Result of a live run. frames: indices with a pose. estimates: of these frames, of the first
    person; others: of these frames, a list of the further people's each. latencies: s from each
    frame's appearance to its pose. sizes: (frame, particles, layers) of each change of the search,
    with the first frame that used it."""

    frames: list[int] = field(default_factory=list)
    estimates: list[Estimate] = field(default_factory=list)
    latencies: list[float] = field(default_factory=list)
    sizes: list[tuple[int, int, int]] = field(default_factory=list)
    others: list[list[Estimate]] = field(default_factory=list)

    @property
    def newest(self) -> list[Estimate]:
        """The latest estimate of each person; empty before the first frame."""
        return [*self.estimates[-1:], *(self.others[-1] if self.others else [])]

    def list_estimates(self) -> list[list[Estimate]]:
        """Return each person's estimates."""
        return [self.estimates, *(list(each) for each in zip(*self.others, strict=True))]


@dataclass(frozen=True, eq=False)
class LiveStart:
    """Start of a live run. grid: of the voxels; None for image features. body: the body to track,
    from `pose` (D,) on. others: bodies and poses of further people, who have voxels."""

    grid: VoxelGrid | None
    body: BodyModel
    pose: np.ndarray
    others: tuple[tuple[BodyModel, np.ndarray], ...] = ()


class Live:
    """Tracks the bodies of its `start` through the frames that `source` delivers.

    Three threads pass on the newest frame and drop older ones. The processing of a frame (features,
    or voxels) begins when the tracker is free, so that no frame waits and none is processed in
    vain. On a GPU, which leaves the host's cores idle, the processing begins earlier, so that it
    ends just when the tracker becomes free.

    searches: one method in one size, or in several, ascending. The largest size that allows
    `budget`, frames per second, is used; the default is the frame rate of the source, if that is
    possible, see `Governor`. follow: the voxel grid moves with the person. scale: of the images.

    How each person is searched for says `LivePerson`. With several people, all are reconstructed
    together, and the voxels are divided among them, see `VoxelObserver`.
    """

    def __init__(
        self,
        device: Device,
        source: Source,
        start: LiveStart,
        searches: Sequence[Method],
        *,
        budget: float | None = None,
        follow: bool = False,
        scale: float = 1.0,
        config: LiveConfig | None = None,
    ) -> None:
        self._config = config or LiveConfig()
        self.device, self.source, self.body = device, source, start.body
        self.timeline = Timeline(STAGES)
        self.result = LiveResult()
        self._searches = searches
        self._overlaps = device.is_gpu
        self.processor = device.sibling()
        pictures = Smaller(source, scale)
        rig = with_hidden_maps(pictures.rig) if start.others else pictures.rig
        people = (start.body, start.pose), *start.others
        self._batch = Batch(device, len(people))
        self.persons = self._batch.run(
            [
                partial(
                    LivePerson, Scene(device, rig, start.grid, body), pose, searches, self._config
                )
                for body, pose in people
            ]
        )
        self.observe = self._observer(pictures, start.grid, follow)
        self._shots = Newest[Shot](lambda shot: self.timeline.drop(PROCESSING, shot.frame.index))
        self._ready = Newest[ObservedFrame](
            lambda seen: self.timeline.drop(TRACKING, seen.shot.frame.index)
        )
        self._free, self._stop = threading.Event(), threading.Event()
        self._free.set()
        self._errors: list[BaseException] = []
        self._free_at, self._processing_time = 0.0, 0.0
        self.governor = self._prepare(budget)
        self._tracking_time = float(self.governor.costs[self.governor.chosen])
        self.start_selected()

    @property
    def expected_rate(self) -> float:
        """Poses per second to expect, from the times measured in the first frame."""
        searching = float(self.governor.costs[self.governor.chosen])
        overlapped = max(self._processing_time, searching)
        return 1 / (overlapped if self._overlaps else self._processing_time + searching)

    @property
    def processing_time(self) -> float:
        """Time, s, from a frame to the start of its search."""
        return self._processing_time

    def run(self, progress: Callable[[LiveResult, Timeline], object] | None = None) -> LiveResult:
        """Track until the source ends, `stop` is called, or a KeyboardInterrupt, which ends the run
        without an error.

        Raises the exception of any of the threads.
        """
        work = (self._acquire, self._process, self._track)
        threads = [
            threading.Thread(target=self._run_part, args=(part,), name=stage, daemon=True)
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
        """End the run after the work in progress."""
        self._stop.set()
        self._shots.close()
        self._ready.close()
        self._free.set()

    # Threads --------------------------------------------------------------------------------

    def _run_part(self, part: Callable[[], None]) -> None:
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
                begin = self._free_at - (1 + self._config.early) * self._processing_time
                self._stop.wait(max(0.0, begin - self.timeline.now()))
            shot = self._shots.take()
            if shot is None:
                break
            self._free.clear()
            start = self.timeline.now()
            with self.timeline.span(PROCESSING, shot.frame.index):
                observed = ObservedFrame(shot, self.observe(shot.frame, shot.time))
                self.processor.finish()
            self._processing_time = self._update_mean(
                self._processing_time, self.timeline.now() - start
            )
            self._ready.put(observed)
        self._ready.close()

    def _track(self) -> None:
        while (observed := self._ready.take()) is not None:
            shot = observed.shot
            start = self.timeline.now()
            self._free_at = start + self._tracking_time
            with self.timeline.span(TRACKING, shot.frame.index):
                self.expect(observed)
                self._observe_people(observed.seen)
                if self._overlaps:  # the trackers no longer need the observations
                    self.device.finish()
                    self._free.set()
                estimates = self.search()
            latency = self.timeline.result(shot.frame.index, shot.time)
            seconds = self.timeline.now() - start
            if not self._overlaps:  # else the next frame may lie here, not yet observed
                self._free.set()
            self.keep(observed, estimates, latency)
            self._tracking_time = self._update_mean(self._tracking_time, seconds)
            if self.governor.update(self._processing_time, seconds):
                self.start_selected()

    def expect(self, observed: ObservedFrame) -> None:
        """Set each person's search region, see `LivePerson.expect`."""
        for person, (_, centre) in zip(self.persons, observed.seen, strict=True):
            person.expect(observed.shot.time, centre, 1 / self.source.fps)

    def search(self) -> list[Estimate]:
        """Enqueue all searches; then wait for them and return their estimates."""
        trackers = [person.tracker for person in self.persons]
        self._batch.run([tracker.enqueue_search for tracker in trackers])
        searches = [tracker.fetch_estimates() for tracker in trackers]
        return [search()[0] for search in searches]

    def _observe_people(self, seen: Sequence[Seen]) -> None:
        """Enqueue the likelihood's preparation of what each person's tracker observes."""
        pairs = zip(self.persons, seen, strict=True)
        self._batch.run(
            [partial(person.tracker.observe, observation) for person, (observation, _) in pairs]
        )

    def keep(self, observed: ObservedFrame, estimates: list[Estimate], latency: float) -> None:
        """Add each person's estimate to the result, see `LivePerson.keep`."""
        triples = zip(self.persons, observed.seen, estimates, strict=True)
        kept = [
            person.keep(estimate, observed.shot.time, centre)
            for person, (_, centre), estimate in triples
        ]
        self.result.frames.append(observed.shot.frame.index)
        if len(kept) > 1:
            self.result.others.append(kept[1:])
        self.result.estimates.append(kept[0])
        self.result.latencies.append(latency)

    # Preparation ----------------------------------------------------------------------------

    def _observer(self, pictures: Smaller, grid: VoxelGrid | None, follow: bool) -> Observer:
        """Return the function that converts a frame to what each tracker observes."""
        method = self._searches[0]
        if not method.uses_voxels:
            return observe_features(self.processor, pictures, method)
        assert grid is not None, "voxels have a grid"
        return VoxelObserver.create(
            self.processor, pictures, grid, self.persons, self._config, follow
        )

    def _prepare(self, budget: float | None) -> Governor:
        """Compile and time everything in the first frame; return the governor."""
        frame = self.source.first()
        for _ in range(2):
            start = time.perf_counter()
            seen = self.observe(frame, 0.0)
            self.processor.finish()
            self._processing_time = time.perf_counter() - start
        costs = [self._measure_cost(size, seen) for size in range(len(self._searches))]
        return Governor(
            1 / (budget or self.source.fps),
            costs,
            self._processing_time,
            overlaps=self._overlaps,
            generous=budget is None,
            config=self._config.governor,
        )

    def _update_mean(self, mean: float, value: float) -> float:
        return mean + self._config.smoothing * (value - mean)

    def _measure_cost(self, size: int, seen: list[Seen]) -> float:
        """Return the least time, s, of a search for everybody."""
        for person in self.persons:
            person.select(size)
        seconds = []
        for _ in range(1 + self._config.n_probes):
            start = time.perf_counter()
            self._observe_people(seen)
            self.search()
            seconds.append(time.perf_counter() - start)
        return min(seconds[1:])

    def start_selected(self) -> None:
        """Start the trackers of the size that the governor selected."""
        chosen = self.governor.chosen
        frame = self.result.frames[-1] if self.result.frames else -1
        search = self._searches[chosen].filter.search
        self.result.sizes.append((frame + 1, search.n_particles, search.n_layers))
        for person in self.persons:
            person.select(chosen)
