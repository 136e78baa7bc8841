"""Live tracking: acquisition, image processing and tracking in separate threads."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from apf.backend import make_device_tracker, make_observer
from apf.body.model import BodyModel
from apf.filters.base import DeviceTracker, Estimate
from apf.filters.config import SIGMA_FPS
from apf.filters.method import Method
from apf.likelihood.observations import Shown
from apf.live.budget import Governor
from apf.live.config import LiveConfig
from apf.live.pictures import Smaller
from apf.live.sources import ACQUISITION, Newest, Shot, Source
from apf.live.timeline import Timeline
from apf.scene import Scene
from apf.tracking.recovery import Judge
from cl import Device
from psfs.reconstructor import Reconstructor
from psfs.sequence import Frame
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.moving_grid import MeanPosition

PROCESSING, TRACKING = "processing", "tracking"
STAGES = (ACQUISITION, PROCESSING, TRACKING)


@dataclass(frozen=True, eq=False)
class ObservedFrame:
    """A frame as the trackers observe it, and the centre (3,) m of its voxels; None without
    voxels."""

    shot: Shot
    observation: Shown
    centre: np.ndarray | None


@dataclass
class LiveResult:
    """Result of a live run. frames: indices with a pose. estimates: of these frames. latencies: s
    from each frame's appearance to its pose. sizes: (frame, particles, layers) of each change of
    the search, with the first frame that used it."""

    frames: list[int] = field(default_factory=list)
    estimates: list[Estimate] = field(default_factory=list)
    latencies: list[float] = field(default_factory=list)
    sizes: list[tuple[int, int, int]] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class LiveStart:
    """Start of a live run. grid: of the voxels; None for image features. body: the body to track,
    from `pose` (D,) on."""

    grid: VoxelGrid | None
    body: BodyModel
    pose: np.ndarray


class Live:
    """Tracks a body from its `start` through the frames that `source` delivers.

    Three threads pass on the newest frame and drop older ones. The processing of a frame (features,
    or voxels) begins when the tracker is free, so that no frame waits and none is processed in
    vain. On a GPU, which leaves the host's cores idle, the processing begins earlier, so that it
    ends just when the tracker becomes free.

    searches: one method in one size, or in several, ascending. The largest size that allows
    `budget`, frames per second, is used; the default is the frame rate of the source, if that is
    possible, see `Governor`. follow: the voxel grid moves with the person. scale: of the images.

    In each frame the search starts from the last pose, moved with the voxels. If an estimate does
    not fit, it is lost, see `Judge`: it holds the last good pose, moved with the voxels, and the
    next frame is searched more widely around it.
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
        grid, body, pose = start.grid, start.body, start.pose
        self.device, self.source, self.body = device, source, body
        self.timeline = Timeline(STAGES)
        self.result = LiveResult()
        self._grid, self._searches, self._pose = grid, searches, pose
        self._judge = Judge(self._config.recovery.for_body(body))
        # time and centre of the voxels of the last good pose
        self._seen: tuple[float, np.ndarray | None] = 0.0, None
        self._overlaps = device.is_gpu
        self.processor = device.sibling()
        self._pictures = Smaller(source, scale)
        self.observe = self._observer(follow)
        self._translation, self._moved = translation(body), np.zeros(body.n_dof)
        self._shots = Newest[Shot](lambda shot: self.timeline.drop(PROCESSING, shot.frame.index))
        self._ready = Newest[ObservedFrame](
            lambda seen: self.timeline.drop(TRACKING, seen.shot.frame.index)
        )
        self._free, self._stop = threading.Event(), threading.Event()
        self._free.set()
        self._errors: list[BaseException] = []
        self._free_at, self._processing_time = 0.0, 0.0
        scene = Scene(device, self._pictures.rig, grid, body)
        self._trackers = [make_device_tracker(scene, method) for method in searches]
        self.governor = self._prepare(budget)
        self._tracking_time = float(self.governor.costs[self.governor.chosen])
        self.tracker = self.start_selected()

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
                observed = ObservedFrame(shot, *self.observe(shot.frame))
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
                self.tracker.observe(observed.observation)
                if self._overlaps:  # the tracker no longer needs the observation
                    self.device.finish()
                    self._free.set()
                estimate = self.tracker.search()
            latency = self.timeline.result(shot.frame.index, shot.time)
            seconds = self.timeline.now() - start
            self._free.set()
            self.keep(observed, estimate, latency)
            self._tracking_time = self._update_mean(self._tracking_time, seconds)
            if self.governor.update(self._processing_time, seconds):
                self.tracker = self.start_selected()

    def expect(self, observed: ObservedFrame) -> None:
        """Set the search region: around the last good pose, moved with the voxels, and wider the
        more time has passed since then."""
        when, where = self._seen
        gap = max(observed.shot.time - when, 1 / self.source.fps)
        self.tracker.widen(SIGMA_FPS * min(gap, self._config.max_gap))
        self._moved = np.zeros(self.body.n_dof)
        if where is not None and observed.centre is not None:
            self._moved = self._translation @ (observed.centre - where)
            self.tracker.push(self._moved)

    def keep(self, observed: ObservedFrame, estimate: Estimate, latency: float) -> None:
        """Add the estimate to the result. A lost estimate gets the last good pose, moved with the
        voxels, so that the track does not drift."""
        estimate = self._judge.judge(estimate)
        if (
            not self._searches[0].uses_voxels
            and estimate.least_error[-1] >= self._config.max_objective_error
        ):
            estimate = replace(estimate, lost=True)
        if estimate.lost:
            self.tracker.start(self._pose)
            moved = np.clip(self._pose + self._moved, self.body.lower, self.body.upper)
            estimate = replace(estimate, pose=moved)
        else:
            self._judge.accept(estimate)
            self._pose = estimate.pose
            self._seen = observed.shot.time, observed.centre
        self.result.frames.append(observed.shot.frame.index)
        self.result.estimates.append(estimate)
        self.result.latencies.append(latency)

    # Preparation ----------------------------------------------------------------------------

    def _observer(self, follow: bool) -> Callable[[Frame], tuple[Shown, np.ndarray | None]]:
        """Return the function that converts a frame to the trackers' observation and the centre of
        its voxels."""
        method, smaller, device = self._searches[0], self._pictures, self.processor
        if not method.uses_voxels:
            features = make_observer(device, smaller, None, method)
            return lambda frame: (features(smaller(frame)), None)
        assert self._grid is not None, "voxels have a grid"
        reconstruct = Reconstructor(
            device,
            smaller.rig,
            self._grid,
            smaller.background,
            self._config.reconstruction,
            sparse=True,
            follow=follow,
        )
        mean_of = MeanPosition(
            device, self._grid.shape, reconstruct.voxels.surface, reconstruct.voxels.count
        )

        def observe(frame: Frame) -> tuple[Shown, np.ndarray | None]:
            voxels, mean = reconstruct(smaller(frame)), mean_of()
            grid = voxels.grid
            return voxels, None if mean is None else grid.origin + mean * grid.voxel_size

        return observe

    def _prepare(self, budget: float | None) -> Governor:
        """Compile and time everything in the first frame; return the governor."""
        frame = self.source.first()
        for _ in range(2):
            start = time.perf_counter()
            observation, _ = self.observe(frame)
            self.processor.finish()
            self._processing_time = time.perf_counter() - start
        costs = [self._measure_cost(tracker, observation) for tracker in self._trackers]
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

    def _measure_cost(self, tracker: DeviceTracker, observation: Shown) -> float:
        """Return the least time, s, of a search."""
        tracker.start(self._pose)
        seconds = []
        for _ in range(1 + self._config.n_probes):
            start = time.perf_counter()
            tracker.step(observation)
            seconds.append(time.perf_counter() - start)
        return min(seconds[1:])

    def start_selected(self) -> DeviceTracker:
        """Return the tracker of the size that the governor selected, started."""
        chosen = self.governor.chosen
        frame = self.result.frames[-1] if self.result.frames else -1
        search = self._searches[chosen].filter.search
        self.result.sizes.append((frame + 1, search.n_particles, search.n_layers))
        self._trackers[chosen].start(self._pose)
        return self._trackers[chosen]


def translation(body: BodyModel) -> np.ndarray:
    """Return (D, 3): the change of a pose of `body` if the whole body moves by a vector, m."""
    matrix = np.zeros((body.n_dof, 3))
    for axis in body.bones[0].axes:
        if axis.kind in ("tx", "ty", "tz"):
            matrix[axis.dof, "xyz".index(axis.kind[1])] = axis.sign
    return matrix
