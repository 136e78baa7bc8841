"""One person of a live run, and what the tracker of each observes in a frame's pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from apf.backend import make_device_tracker, make_feature_observer
from apf.body.cones import body_spheres, count_spheres
from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.filters.base import DeviceTracker, Estimate
from apf.filters.config import SIGMA_FPS
from apf.filters.method import Method
from apf.likelihood.observations import Shown
from apf.live.config import LiveConfig
from apf.live.sources import Smaller
from apf.scene import Scene
from apf.tracking.recovery import Judge
from cl import Device
from psfs.people.following import SPEED
from psfs.reconstructor import Reconstructor
from psfs.sequence import Frame
from psfs.voxels.device_voxels import CarvedVoxels
from psfs.voxels.division import Division
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.moving_grid import MeanPosition

#: What a tracker observes, and the centre (3,) m of its voxels; None without voxels.
Seen = tuple[Shown, "np.ndarray | None"]
#: Returns what each person's tracker observes in a frame at a time, s.
Observer = Callable[[Frame, float], list[Seen]]


class LivePerson:
    """A person who is searched for in each frame from the last pose, moved with the voxels.

    If an estimate does not fit, it is lost, see `Judge`: it holds the last good pose, moved with
    the voxels, and the next frame is searched more widely around it.
    """

    def __init__(
        self, scene: Scene, pose: np.ndarray, searches: Sequence[Method], config: LiveConfig
    ) -> None:
        self.body, self.pose = scene.body, pose
        self.trackers: list[DeviceTracker] = [
            make_device_tracker(scene, method) for method in searches
        ]
        self.tracker = self.trackers[0]
        self._uses_voxels, self._config = searches[0].uses_voxels, config
        self._judge = Judge(config.recovery)
        self._translation = make_translation_matrix(self.body)
        self._moved = np.zeros(self.body.n_dof)
        # time and centre of the voxels of the last good pose
        self._seen: tuple[float, np.ndarray | None] = 0.0, None
        self._places: tuple[tuple[float, np.ndarray], ...] = ((0.0, self._centre(pose)),)

    def select(self, size: int) -> None:
        """Search in this of the sizes from now on."""
        self.tracker = self.trackers[size]
        self.tracker.start(self.pose)

    def expect(self, time: float, centre: np.ndarray | None, period: float) -> None:
        """Set the search region of a frame at `time`, s: around the last good pose, moved with the
        `centre` (3,) of the voxels, and wider the more time has passed since then. period: of
        frames, s."""
        when, where = self._seen
        gap = max(time - when, period)
        self.tracker.widen(SIGMA_FPS * min(gap, self._config.max_gap))
        self._moved = np.zeros(self.body.n_dof)
        if where is not None and centre is not None:
            self._moved = self._translation @ (centre - where)
            self.tracker.push(self._moved)

    def keep(self, estimate: Estimate, time: float, centre: np.ndarray | None) -> Estimate:
        """Return the estimate with its confidence. A lost one gets the last good pose, moved with
        the voxels, so that the track does not drift."""
        estimate = self._judge.judge(estimate)
        if not self._uses_voxels and estimate.least_error[-1] >= self._config.max_objective_error:
            estimate = replace(estimate, lost=True)
        if estimate.lost:
            self.tracker.start(self.pose)
            moved = np.clip(self.pose + self._moved, self.body.lower, self.body.upper)
            return replace(estimate, pose=moved)
        self._judge.accept(estimate)
        self.pose = estimate.pose
        self._seen = time, centre
        self._places = (*self._places, (time, self._centre(self.pose)))[-2:]
        return estimate

    def expect_spheres(self, time: float) -> np.ndarray:
        """Return spheres (K, 4) m about where the body is expected at `time`, s: at the last good
        pose, moved on as it moved before for at most `max_gap`."""
        (then, there), (last, here) = self._places[0], self._places[-1]
        spheres = body_spheres(self.body, self.pose)
        if last > then:
            velocity = (here - there) / (last - then)
            velocity /= max(1.0, float(np.linalg.norm(velocity)) / SPEED)
            spheres[:, :3] += velocity * np.clip(time - last, 0.0, self._config.max_gap)
        return spheres

    def _centre(self, pose: np.ndarray) -> np.ndarray:
        return np.asarray(posed_joints(self.body, pose[None])[0].mean(0))


def make_translation_matrix(body: BodyModel) -> np.ndarray:
    """Return (D, 3): the change of a pose of `body` if the whole body moves by a vector, m."""
    matrix = np.zeros((body.n_dof, 3))
    for axis in body.bones[0].axes:
        if axis.kind in ("tx", "ty", "tz"):
            matrix[axis.dof, "xyz".index(axis.kind[1])] = axis.sign
    return matrix


def observe_features(device: Device, pictures: Smaller, method: Method) -> Observer:
    """Return the observer of image features, of one person."""
    features = make_feature_observer(device, pictures, method.features)
    return lambda frame, time: [(features(pictures.resize(frame)), None)]


class VoxelObserver:
    """Observer of voxels: one reconstruction for all, divided among several persons by where each
    is expected. follow: the grid moves with the only person."""

    def __init__(
        self,
        device: Device,
        pictures: Smaller,
        grid: VoxelGrid,
        persons: Sequence[LivePerson],
        config: LiveConfig,
        follow: bool,
    ) -> None:
        self.pictures, self.persons = pictures, persons
        self.reconstruct = Reconstructor(
            device, pictures.rig, grid, pictures.background, config.reconstruction,
            follow=follow,
        )  # fmt: skip
        self.division: Division | None = None
        self.parts: Sequence[CarvedVoxels] = [self.reconstruct.voxels]
        if len(persons) > 1:
            n_spheres = count_spheres(persons[0].body)
            self.division = Division(
                device, pictures.rig, self.reconstruct.voxels, [grid] * len(persons), n_spheres,
                config.reconstruction,
            )  # fmt: skip
            self.parts = self.division.persons
        self.means = [MeanPosition(device, grid.shape, p.surface, p.count) for p in self.parts]

    @property
    def grid(self) -> VoxelGrid:
        """The voxels' grid, where it is now."""
        return self.reconstruct.voxels.grid

    def __call__(self, frame: Frame, time: float) -> list[Seen]:
        voxels = self.reconstruct(self.pictures.resize(frame))
        if self.division is not None:
            spheres = [person.expect_spheres(time) for person in self.persons]
            self.division.spheres.set(np.stack(spheres).astype(np.float32))
            self.division()
        seen: list[Seen] = []
        for part, mean_of in zip(self.parts, self.means, strict=True):
            mean = mean_of()
            centre = None if mean is None else voxels.grid.origin + mean * voxels.grid.voxel_size
            seen.append((part, centre))
        return seen
