"""Live tracking: acquisition, image processing and tracking in separate threads."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from apf.body.model import BodyModel
from apf.filters.base import Estimate
from apf.filters.method import Method
from apf.live.config import LiveConfig
from apf.live.people import LivePerson, Observer, Seen, VoxelObserver, observe_features
from apf.live.send import SentPose
from apf.live.sources import ACQUISITION, Newest, Shot, Smaller, Source
from apf.live.timeline import Span, Timeline
from apf.scene import Scene
from cl import Device, InputError
from psfs.common.system import PATIENCE
from psfs.people.separation import with_hidden_maps
from psfs.voxels.grid import VoxelGrid

PROCESSING, TRACKING = "processing", "tracking"
STAGES = (ACQUISITION, PROCESSING, TRACKING)
#: Frames over whose median time the size of a search is chosen.
WINDOW = 8


def list_sizes(method: Method, config: LiveConfig | None = None) -> list[Method]:
    """Return `method` in all sizes to choose from, ascending: each larger than the one before by as
    much as the governor can tell apart."""
    config = config or LiveConfig()
    n_sizes = 1 + round(np.log(config.most / config.fewest) / -np.log(config.share**2))
    counts = np.geomspace(config.fewest, config.most, n_sizes)
    return [resize_search(method, count) for count in counts]


def resize_search(method: Method, evaluations: float) -> Method:
    """Return `method` with particles and layers for about `evaluations` per frame.

    Ten layers for a thousand evaluations, fewer below, more above: a swarm with fewer than six does
    not converge, and beyond fifteen it gains little (Rymut 2016, figure 6.9).
    """
    before = method.filter.search
    layers = 1 if method.search == "sir" else min(15, round(np.sqrt(evaluations / 10)))
    size = {"n_particles": round(evaluations / layers), "n_layers": layers}
    if method.search == "apf":
        size["trunk_layers"] = round(before.trunk_layers * layers / before.n_layers)
    return method.replace(filter=method.filter.with_changes(**size))


class Governor:
    """Selects the largest search that keeps up with the frame rate.

    costs: s that each search takes, ascending. period: s available per frame; `share` of it is
    planned with. overlaps: the next frame is processed during a search, else before it. generous: a
    search may take as long as the processing, even if the period is exceeded; if the processing
    alone takes too long, smaller searches would hardly raise the frame rate. `chosen`: index of the
    selected search.
    """

    def __init__(
        self,
        period: float,
        costs: Sequence[float],
        processing: float,
        *,
        overlaps: bool = False,
        generous: bool = False,
        share: float = LiveConfig().share,
    ) -> None:
        self._share = share
        self.period, self.costs = period, np.maximum.accumulate(costs)
        self._overlaps, self._generous = overlaps, generous
        self._slower: deque[float] = deque(maxlen=WINDOW)
        self.chosen = self._largest(self.search_time(processing), 1.0)

    def search_time(self, processing: float) -> float:
        """Return the time, s, available for a search if the processing takes `processing` s."""
        left = self._share * self.period - (0.0 if self._overlaps else processing)
        return max(left, processing) if self._generous else left

    def update(self, processing: float, seconds: float) -> bool:
        """Update the selection after a frame that was processed in about `processing` s and
        searched in `seconds`; return whether the selection changed."""
        self._slower.append(seconds / self.costs[self.chosen])
        if len(self._slower) < WINDOW:
            return False
        slower, allowed = float(np.median(self._slower)), self.search_time(processing)
        before, taken = self.chosen, slower * self.costs[self.chosen]
        if taken > allowed / self._share:
            self.chosen = self._largest(allowed, slower)
        else:
            roomy = self._largest(self._share**2 * allowed, slower)
            self.chosen = max(before, roomy)
        if self.chosen != before:
            self._slower.clear()
        return self.chosen != before

    def _largest(self, allowed: float, slower: float) -> int:
        """Return the largest search within `allowed` s if all take `slower` times their cost."""
        return max(0, int(np.count_nonzero(slower * self.costs <= allowed)) - 1)


@dataclass(frozen=True, eq=False)
class ObservedFrame:
    """A frame as the tracker of each person observes it."""

    shot: Shot
    seen: list[Seen]


@dataclass
class LiveResult:
    """Result of a live run. frames: indices with a pose. estimates: of these frames, one of each
    person. latencies: s from each frame's appearance to its pose. sizes: (frame, particles, layers)
    of each change of the search, with the first frame that used it. sent_after: s from each frame's
    appearance to its last packet, if poses are sent. error: that ended the run."""

    frames: list[int] = field(default_factory=list)
    estimates: list[list[Estimate]] = field(default_factory=list)
    latencies: list[float] = field(default_factory=list)
    sizes: list[tuple[int, int, int]] = field(default_factory=list)
    sent_after: list[float] = field(default_factory=list)
    error: BaseException | None = None

    @property
    def newest(self) -> list[Estimate]:
        """The latest estimate of each person; empty before the first frame."""
        return self.estimates[-1] if self.estimates else []


#: What a run reports to.
Progress = Callable[[LiveResult, Timeline], object]


@dataclass(frozen=True, eq=False)
class LiveStart:
    """Start of a live run. grid: of the voxels; None for image features. people: the bodies to
    track, each from a pose (D,) on; only one without voxels."""

    grid: VoxelGrid | None
    people: Sequence[tuple[BodyModel, np.ndarray]]


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
        self.device = device
        self.timeline, self.result = Timeline(STAGES), LiveResult()
        self._searches, self._budget, self._follow, self.scale = searches, budget, follow, scale
        #: What is called with each pose as soon as it is known, such as `Sender.send`.
        self.listeners: list[Callable[[SentPose], object]] = []
        self._overlaps = device.is_gpu
        self.processor = device.sibling()
        self._begin(source, start)

    def _begin(self, source: Source, start: LiveStart) -> None:
        """Prepare everything for a source: at the start, and when it has lost a camera."""
        self.source, device = source, self.device
        pictures = Smaller(source, self.scale)
        rig = with_hidden_maps(pictures.rig) if len(start.people) > 1 else pictures.rig
        self.persons = [
            LivePerson(Scene(device, rig, start.grid, body), pose, self._searches, self._config)
            for body, pose in start.people
        ]
        method = self._searches[0]
        self.observe: Observer
        if method.uses_voxels:
            assert start.grid is not None, "voxels have a grid"
            self.observe = VoxelObserver(
                self.processor, pictures, start.grid, self.persons, self._config, self._follow
            )
        else:
            self.observe = observe_features(self.processor, pictures, method)
        self._shots = Newest[Shot](lambda shot: self.timeline.drop(PROCESSING, shot.frame.index))
        self._ready = Newest[ObservedFrame](
            lambda seen: self.timeline.drop(TRACKING, seen.shot.frame.index)
        )
        self._free, self._stop = threading.Event(), threading.Event()
        self._free.set()
        self._free_at = 0.0
        self._processing = deque[float](maxlen=WINDOW)
        self.governor = self._prepare()
        self._tracking = deque([float(self.governor.costs[self.governor.chosen])], WINDOW)
        self.start_selected()

    @property
    def most_layers(self) -> int:
        """Number of layers of the largest search."""
        return max(method.filter.search.n_layers for method in self._searches)

    @property
    def expected_rate(self) -> float:
        """Poses per second to expect, from the times measured in the first frame."""
        searching = float(self.governor.costs[self.governor.chosen])
        overlapped = max(self.processing_time, searching)
        return 1 / (overlapped if self._overlaps else self.processing_time + searching)

    @property
    def processing_time(self) -> float:
        """Time, s, from a frame to the start of its search."""
        return float(np.median(self._processing))

    def run(
        self,
        progress: Sequence[Progress] = (),
        warn: Callable[[str], object] = lambda text: None,
    ) -> LiveResult:
        """Track until the source ends, `stop` is called, or a KeyboardInterrupt, which ends the run
        without an error. progress: called several times a second.

        If a camera is gone or comes back, `warn` is told, and the run goes on with those that give
        pictures if they suffice. An exception ends the run, and is in the result, with what was
        tracked.
        """
        self.timeline = Timeline(STAGES)
        try:
            self._run_threads(progress)
            while self.source.changed and self.result.error is None:
                why, rest = self.source.changed, self.source.with_present()
                if rest is None:
                    self.result.error = InputError(f"{why}; too few cameras are left")
                    break
                warn(f"{why}; the run goes on with {', '.join(rest.rig.names)}")
                people = [(person.body, person.pose) for person in self.persons]
                grid = self.observe.grid if isinstance(self.observe, VoxelObserver) else None
                self._begin(rest, LiveStart(grid, people))
                self._run_threads(progress)
        except KeyboardInterrupt:
            pass
        except Exception as error:  # also of `progress`: what was tracked is kept
            self.result.error = self.result.error or error
        return self.result

    def _run_threads(self, progress: Sequence[Progress]) -> None:
        work = (self._acquire, self._process, self._track)
        threads = [
            threading.Thread(target=self._run_part, args=(part,), name=stage, daemon=True)
            for part, stage in zip(work, STAGES, strict=True)
        ]
        for thread in threads:
            thread.start()
        try:
            while threads[-1].is_alive():
                threads[-1].join(0.1)
                for report in progress:
                    report(self.result, self.timeline)
        finally:
            self.stop()
            for thread in threads:
                thread.join(PATIENCE)  # after it a driver hangs

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
            self.result.error = self.result.error or error
            self.stop()

    def _acquire(self) -> None:
        self.source.run(self._shots, self.timeline, self._stop)
        self._shots.close()

    def _process(self) -> None:
        while not self._stop.is_set():
            self._free.wait()
            if self._overlaps:
                begin = self._free_at - max(self._processing)
                self._stop.wait(max(0.0, begin - self.timeline.now()))
            shot = self._shots.take()
            if shot is None:
                break
            self._free.clear()
            start = self.timeline.now()
            observed = ObservedFrame(shot, self.observe(shot.frame, shot.time))
            self.processor.finish()
            end = self.timeline.now()
            self.timeline.add(Span(PROCESSING, shot.frame.index, start, end))
            self._processing.append(end - start)
            self._ready.put(observed)
        self._ready.close()

    def _track(self) -> None:
        while (observed := self._ready.take()) is not None:
            shot = observed.shot
            start = self.timeline.now()
            self._free_at = start + float(np.median(self._tracking))
            self.expect(observed)
            self._observe_people(observed.seen)
            if self._overlaps:  # the trackers no longer need the observations
                self.device.finish()
                self._free.set()
            estimates = self.search()
            known = self.timeline.now()
            self.timeline.add(Span(TRACKING, shot.frame.index, start, known))
            self.timeline.add_result(shot.frame.index, shot.time, known)
            if not self._overlaps:  # else the next frame may lie here, not yet observed
                self._free.set()
            self.keep(observed, estimates, known - shot.time)
            self._tracking.append(known - start)
            if self.governor.update(self.processing_time, known - start):
                self.start_selected()

    def expect(self, observed: ObservedFrame) -> None:
        """Set each person's search region, see `LivePerson.expect`."""
        for person, (_, centre) in zip(self.persons, observed.seen, strict=True):
            person.expect(observed.shot.time, centre, 1 / self.source.fps)

    def search(self) -> list[Estimate]:
        """Enqueue all searches; then wait for them and return their estimates."""
        trackers = [person.tracker for person in self.persons]
        for tracker in trackers:
            tracker.enqueue_search()
        searches = [tracker.fetch_estimate() for tracker in trackers]
        return [search() for search in searches]

    def _observe_people(self, seen: Sequence[Seen]) -> None:
        """Enqueue the likelihood's preparation of what each person's tracker observes."""
        for person, (observation, _) in zip(self.persons, seen, strict=True):
            person.tracker.observe(observation)

    def keep(self, observed: ObservedFrame, estimates: list[Estimate], latency: float) -> None:
        """Add each person's estimate to the result, see `LivePerson.keep`."""
        triples = zip(self.persons, observed.seen, estimates, strict=True)
        kept = [
            person.keep(estimate, observed.shot.time, centre)
            for person, (_, centre), estimate in triples
        ]
        self.result.frames.append(observed.shot.frame.index)
        self.result.estimates.append(kept)
        self.result.latencies.append(latency)
        pose = SentPose(observed.shot.frame.index, observed.shot.time, kept)
        for listener in self.listeners:
            with suppress(OSError):  # nobody is there now; the next pose may be heard
                listener(pose)
        if self.listeners:
            self.result.sent_after.append(self.timeline.now() - observed.shot.time)

    # Preparation ----------------------------------------------------------------------------

    def _prepare(self) -> Governor:
        """Compile and time everything in the first frame; return the governor."""
        frame = self.source.first()
        for _ in range(2):
            start = time.perf_counter()
            seen = self.observe(frame, 0.0)
            self.processor.finish()
            seconds = time.perf_counter() - start
        self._processing.append(seconds)
        costs = [self._measure_cost(size, seen) for size in range(len(self._searches))]
        return Governor(
            1 / (self._budget or self.source.fps),
            costs,
            self.processing_time,
            overlaps=self._overlaps,
            generous=self._budget is None,
            share=self._config.share,
        )

    def _measure_cost(self, size: int, seen: list[Seen]) -> float:
        """Return the least time, s, of a search for everybody."""
        for person in self.persons:
            person.select(size)
        seconds = []
        for _ in range(3):  # one to compile
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
