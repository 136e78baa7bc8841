"""Trackers of several people on one reconstruction, whose searches do not wait for each other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from apf.backend import make_device_tracker
from apf.body.cones import body_spheres, count_spheres
from apf.body.model import BodyModel
from apf.filters.base import Estimate, begin_searches
from apf.filters.method import Method
from apf.scene import Scene
from apf.tracking.take import StartedTake, Take
from cl import Device, InputError
from psfs.cameras.camera import CameraRig
from psfs.people.separation import PersonSession, with_hidden_maps
from psfs.voxels.device_voxels import CarvedVoxels
from psfs.voxels.division import Division


class PeopleTracker:
    """Trackers of several people who share one reconstruction (Song et al. 2.3, for each person).

    device: an OpenCL device. rig: V cameras. voxels: `Reconstructor.voxels` of a reconstructor of
    all people. bodies: one for each of the P people, all with the same parts. method: search,
    objective and settings of each person's tracker.

    In every frame, voxels and foreground are divided among the people by the spheres along their
    limbs, extrapolated from the last two poses, see `psfs.voxels.division`. Then all searches are
    enqueued, and only then the host waits. Each person begins at a given pose. The track of a
    single person equals that of a tracker alone to the bit. Raises InputError without bodies.
    """

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        voxels: CarvedVoxels,
        bodies: Sequence[BodyModel],
        method: Method,
    ) -> None:
        if not bodies:
            raise InputError("the list of bodies is empty; expected a body for each person")
        several = len(bodies) > 1
        own_rig = with_hidden_maps(rig) if several else rig
        self.device = device
        self.trackers = [
            make_device_tracker(Scene(device, own_rig, voxels.grid, body), method)
            for body in bodies
        ]
        # One queue for all searches: with a queue each a frame takes a tenth longer (H200).
        self._queue = device.new_queue() if device.is_gpu else device.queue
        self._division: Division | None = None
        if several:
            n_spheres = count_spheres(bodies[0])
            self._division = Division(device, rig, voxels, [voxels.grid] * len(bodies), n_spheres)
        #: The spheres (P, K, 4) of everybody in the last pose that is known, and before it.
        self._spheres = np.zeros((2, 0))

    def start(self, poses: Sequence[np.ndarray]) -> None:
        """Put each person's particles at their pose (D,), m and rad. Raises InputError for another
        number of poses than people, or an impossible pose."""
        if len(poses) != len(self.trackers):
            raise InputError(
                f"{len(poses)} poses for {len(self.trackers)} people; expected one each"
            )
        for tracker, pose in zip(self.trackers, poses, strict=True):
            tracker.start(pose)
        self._spheres = np.stack(2 * [self._cover(poses)])

    def step(self, voxels: CarvedVoxels) -> list[Estimate]:
        """Track everybody one frame further and return the estimate of each of the P people."""
        return self._finish(self._begin(voxels, ahead=1))

    def stream(self, frames: Iterable[CarvedVoxels]) -> Iterator[list[Estimate]]:
        """Yield each person's estimate for each of `frames`, see `DeviceTracker.stream`."""
        under_way: list[Callable[[], Estimate]] = []
        for voxels in frames:
            following = self._begin(voxels, ahead=2)
            if under_way:
                yield self._finish(under_way)
            under_way = following
        if under_way:
            yield self._finish(under_way)

    def _begin(self, voxels: CarvedVoxels, ahead: int) -> list[Callable[[], Estimate]]:
        """Enqueue the division and all searches of a frame that is `ahead` frames after the latest
        one whose poses are known."""
        parts: Sequence[CarvedVoxels] = [voxels]
        if self._division is not None:
            here, before = self._spheres
            self._division.spheres.set((here + ahead * (here - before)).astype(np.float32))
            parts = self._division()
        shows = [
            tracker.likelihood.prepare(piece)
            for tracker, piece in zip(self.trackers, parts, strict=True)
        ]
        return begin_searches(self.trackers, shows, self._queue)

    def _finish(self, searches: Sequence[Callable[[], Estimate]]) -> list[Estimate]:
        """Wait for the searches of a frame, and return each person's estimate."""
        estimates = [search() for search in searches]
        if self._division is not None:
            here = self._cover([estimate.pose for estimate in estimates])
            self._spheres = np.stack([here, self._spheres[0]])
        return estimates

    def _cover(self, poses: Sequence[np.ndarray]) -> np.ndarray:
        pairs = zip(self.trackers, poses, strict=True)
        return np.stack([body_spheres(tracker.body, pose) for tracker, pose in pairs])


def place_bodies(started: Sequence[StartedTake], takes: Sequence[Take]) -> None:
    """Let the voxels of several people be divided by their tracked bodies."""
    for start, take in zip(started, takes, strict=False):
        if isinstance(start.session, PersonSession):
            track = take.tracks[0]
            poses = zip(track.frames[~track.lost], track.poses[~track.lost], strict=True)
            spheres = {int(frame): body_spheres(take.body, pose) for frame, pose in poses}
            start.session.joint.place(start.session.number, spheres)
