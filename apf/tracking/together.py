"""Trackers of several people on one reconstruction, whose searches do not wait for each other, and
where the people are expected in the next frame (kernel: people.cl)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

import numpy as np

from apf.backend import make_device_tracker
from apf.body.cones import ALONG, body_spheres, count_spheres
from apf.body.kinematics import posed_cones
from apf.body.model import BodyModel
from apf.body.posing import CONE_DEFINES, body_defines, pack_body
from apf.filters.base import DeviceTracker, Estimate, begin_searches
from apf.filters.method import Method
from apf.scene import Scene
from apf.tracking.take import StartedTake, Take
from cl import Array, Device, InputError, Launch
from cl.batch import Batch, Parts
from cl.workgroups import pack_defines
from psfs.cameras.camera import CameraRig
from psfs.common.cones import CONE_FLOATS
from psfs.people.separation import PersonSession, with_hidden_maps
from psfs.voxels.device_voxels import CarvedVoxels
from psfs.voxels.division import Division

#: Frames whose poses are held: the two that the next frame is predicted from, and the one that a
#: search may be writing.
SLOTS = 3


class ExpectedBodies:
    """The posed cones of several bodies in the latest frames, and the spheres expected of them.

    All bodies have the same number of cones. `spheres` (P, K, 4) float32 receives the prediction,
    see `expect`. Twin: reference/likelihood/voxel.py.
    """

    def __init__(self, device: Device, bodies: Sequence[BodyModel], spheres: Array) -> None:
        self._device, self.bodies, self._spheres = device, list(bodies), spheres
        n_cones = len(bodies[0].cones)
        self._cones = Parts(device, SLOTS * len(bodies), (n_cones, CONE_FLOATS), np.float32)
        # By the newest slot and the frames ahead: to set an argument takes longer than a launch.
        self._expect: dict[tuple[int, int], Launch] = {}

    def start(self, person: int, pose: np.ndarray) -> None:
        """Put a person at a pose (D,), at rest."""
        cones = posed_cones(self.bodies[person], pose[None])[0].astype(np.float32)
        for slot in range(SLOTS):
            self._cones.arrays[slot * len(self.bodies) + person].set(cones)

    def pose_launches(self, device: Device, person: int, poses: Array) -> list[Launch]:
        """Return, for each slot, the launch on `device` that puts a person at the first of `poses`
        in it."""
        body = self.bodies[person]
        table = device.to_device(pack_body(body), "the body model")
        defines = body_defines(body) | pack_defines(device, 64)
        return [
            device.launch(
                device.kernel("tracking/kinematics", "pose_cones", **defines, **CONE_DEFINES),
                (defines["GROUP"],),
                (defines["GROUP"],),
                n_particles=1,
                poses=poses,
                table=table,
                posed=self._cones.arrays[slot * len(self.bodies) + person],
            )
            for slot in range(SLOTS)
        ]

    def expect(self, newest: int, ahead: int) -> None:
        """Enqueue the prediction `ahead` frames after frame `newest`, from it and the one before;
        frames before the first are as it started."""
        key = newest % SLOTS, ahead
        if key not in self._expect:
            self._expect[key] = self._expect_launch(*key)
        self._expect[key]()

    def _expect_launch(self, newest: int, ahead: int) -> Launch:
        body = self.bodies[0]
        defines = {
            **{"PEOPLE": len(self.bodies), "N_CONES": len(body.cones), "CONE_FLOATS": CONE_FLOATS},
            **{"STEP": self._cones.step, "ALONG": ALONG},
        }
        return self._device.launch(
            self._device.kernel("tracking/people", "expect_spheres", **defines),
            (len(self.bodies) * count_spheres(body),),
            (64,),
            newest=newest,
            before=(newest - 1) % SLOTS,
            ahead=float(ahead),
            cones=self._cones.whole,
            spheres=self._spheres,
        )


class PeopleTracker:
    """Trackers of several people who share one reconstruction (Song et al. 2.3, for each person).

    device: an OpenCL device. rig: V cameras. voxels: `Reconstructor.voxels` of a reconstructor of
    all people. bodies: one for each of the P people, all with the same parts. method: search,
    objective and settings of each person's tracker. joins: whether one launch serves the searches
    of all people; by default on GPUs.

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
        *,
        joins: bool | None = None,
    ) -> None:
        if not bodies:
            raise InputError("the list of bodies is empty; expected a body for each person")
        several = len(bodies) > 1
        own_rig = with_hidden_maps(rig) if several else rig
        self.device = device
        self._batch = Batch(device, len(bodies), joins)
        self.trackers: list[DeviceTracker] = self._batch.run(
            [
                partial(make_device_tracker, Scene(device, own_rig, voxels.grid, body), method)
                for body in bodies
            ]
        )
        # One queue for all searches: with a queue each a frame takes a tenth longer (H200).
        self._queue = device.new_queue() if device.is_gpu else device.queue
        self._division: Division | None = None
        self._expected: ExpectedBodies | None = None
        self._pose: list[list[Launch]] = []
        self._n_frames = 0
        if several:
            n_spheres = count_spheres(bodies[0])
            self._division = Division(device, rig, voxels, [voxels.grid] * len(bodies), n_spheres)
            self._expected = ExpectedBodies(device, bodies, self._division.spheres)
            self._pose = self._batch.run(
                [
                    partial(self._expected.pose_launches, device, person, tracker.particles.result)
                    for person, tracker in enumerate(self.trackers)
                ]
            )

    @property
    def n_joined(self) -> int:
        """Number of launches that serve all people."""
        return self._batch.n_joined

    def start(self, poses: Sequence[np.ndarray]) -> None:
        """Put each person's particles at their pose (D,), m and rad. Raises InputError for another
        number of poses than people, or an impossible pose."""
        if len(poses) != len(self.trackers):
            raise InputError(
                f"{len(poses)} poses for {len(self.trackers)} people; expected one each"
            )
        for person, (tracker, pose) in enumerate(zip(self.trackers, poses, strict=True)):
            tracker.start(pose)
            if self._expected is not None:
                self._expected.start(person, pose)
        self._n_frames = 0

    def step(self, voxels: CarvedVoxels) -> list[Estimate]:
        """Track everybody one frame further and return the estimate of each of the P people."""
        return [search()[0] for search in self._begin(voxels, ahead=1)]

    def stream(self, frames: Iterable[CarvedVoxels]) -> Iterator[list[Estimate]]:
        """Yield each person's estimate for each of `frames`, see `DeviceTracker.stream`."""
        under_way: list[Callable[[], list[Estimate]]] = []
        for voxels in frames:
            following = self._begin(voxels, ahead=2)
            if under_way:
                yield [search()[0] for search in under_way]
            under_way = following
        if under_way:
            yield [search()[0] for search in under_way]

    def _begin(self, voxels: CarvedVoxels, ahead: int) -> list[Callable[[], list[Estimate]]]:
        """Enqueue the division and all searches of a frame that is `ahead` frames after the latest
        one whose searches the device's queue has waited for."""
        parts: Sequence[CarvedVoxels] = [voxels]
        if self._division is not None and self._expected is not None:
            self._expected.expect(self._n_frames - ahead, ahead)
            parts = self._division()
        pairs = zip(self.trackers, parts, strict=True)
        shows = self._batch.run(
            [partial(tracker.likelihood.prepare, part) for tracker, part in pairs]
        )
        slot, self._n_frames = self._n_frames % SLOTS, self._n_frames + 1
        poses = [launches[slot] for launches in self._pose]
        return begin_searches(self.trackers, shows, self._queue, poses, self._batch)


def place_bodies(started: Sequence[StartedTake], takes: Sequence[Take]) -> None:
    """Let the voxels of several people be divided by their tracked bodies."""
    for start, take in zip(started, takes, strict=False):
        if isinstance(start.session, PersonSession):
            track = take.tracks[0]
            poses = zip(track.frames[~track.lost], track.poses[~track.lost], strict=True)
            spheres = {int(frame): body_spheres(take.body, pose) for frame, pose in poses}
            start.session.joint.place(start.session.number, spheres)
