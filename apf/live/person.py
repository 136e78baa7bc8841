"""One person of a live run: the trackers in all sizes, the last good pose, the expected place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from apf.backend import make_device_tracker
from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.body.spheres import body_spheres
from apf.filters.base import DeviceTracker, Estimate
from apf.filters.config import SIGMA_FPS
from apf.filters.method import Method
from apf.live.config import LiveConfig
from apf.scene import Scene
from apf.tracking.recovery import Judge

#: Greatest speed at which a person is expected elsewhere, m/s.
_FASTEST = 4.0


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
            velocity /= max(1.0, float(np.linalg.norm(velocity)) / _FASTEST)
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
