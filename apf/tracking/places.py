"""Where several people are expected in the next frame, on the device (kernel: people.cl)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from apf.body.kinematics import posed_cones
from apf.body.model import BodyModel
from apf.body.posing import CONE_DEFINES, body_defines, pack_body
from apf.body.spheres import ALONG, count_spheres
from cl import Array, Device, Launch
from cl.parts import Parts
from cl.workgroups import pack_defines
from psfs.common.cones import CONE_FLOATS

#: Frames whose poses are held: the two that the next frame is predicted from, and the one that a
#: search may be writing.
SLOTS = 3


class Places:
    """The posed cones of several bodies in the latest frames, and the spheres expected of them.

    All bodies have the same number of cones. `spheres` (P, K, 4) float32 receives the prediction,
    see `expect`. Twin: reference/people.py.
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
