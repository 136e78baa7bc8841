"""Forward kinematics of all particles on the device (kernel: tracking/kinematics.cl)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from apf.body.cones import FAR_OUT
from apf.body.kinematics import cone_table
from apf.body.model import AXES, BodyModel
from cl import Array, Device, Launch
from cl.program import Define
from cl.workgroups import ALONG, pack_defines, pack_size
from psfs.common.cones import CONE_FLOATS

#: Floats of a bone and of a free axis in the body's table, of a posed bone, and of the additional
#: values for distances to a cone; see kinematics.h and packed_cones.h.
BONE_FLOATS, AXIS_FLOATS, FRAME_FLOATS, SPAN_FLOATS = 16, 4, 12, 8
#: Index in a cone's row of the bone that it is fixed to.
_CONE_BONE = 11
#: The compile-time definitions of cones.h.
CONE_DEFINES: dict[str, Define] = {"CONE_FLOATS": CONE_FLOATS, "FAR_OUT": FAR_OUT}


class Kinematics:
    """Launcher that poses the body's cones for `n_particles` pose vectors.

    `cones` is the device array (N, C, CONE_FLOATS) that the launches of `launcher(poses)` fill.
    """

    def __init__(self, device: Device, body: BodyModel, n_particles: int) -> None:
        self.device = device
        self.body = body
        self.n_particles = n_particles
        self._body = device.to_device(pack_body(body), "the body model")
        shape = (n_particles, len(body.cones), CONE_FLOATS)
        self.cones = device.empty(shape, np.float32, "the posed cones")

    def change_body(self, body: BodyModel) -> None:
        """Replace the body by one that differs in numbers only."""
        self.body = body
        self._body.set(pack_body(body))

    def launcher(self, poses: Array) -> list[Launch]:
        """Return the launches that pose all cones of `poses` (N, D) float32."""
        defines = body_defines(self.body) | pack_defines(self.device, ALONG)
        return [
            self.device.launch(
                self.device.kernel("tracking/kinematics", "pose_cones", **defines, **CONE_DEFINES),
                pack_size(self.n_particles, defines),
                (defines["GROUP"],),
                n_particles=self.n_particles,
                poses=poses,
                table=self._body,
                posed=self.cones,
            )
        ]


def body_defines(body: BodyModel) -> dict[str, int]:
    """Return the compile-time definitions of kinematics.h and packed_cones.h, without those of
    cones.h."""
    return {
        "N_DOF": body.n_dof,
        "N_BONES": len(body.bones),
        "N_LEVELS": max(bone_levels(body)) + 1,
        "N_CONES": len(body.cones),
        "BONE_FLOATS": BONE_FLOATS,
        "AXIS_FLOATS": AXIS_FLOATS,
        "FRAME_FLOATS": FRAME_FLOATS,
        "SPAN_FLOATS": SPAN_FLOATS,
        "CONE_BONE": _CONE_BONE,
    }


def bone_levels(body: BodyModel) -> list[int]:
    """Return the depth of each bone in the tree; 0 for a root."""
    levels: list[int] = []
    for bone in body.bones:
        levels.append(levels[bone.parent] + 1 if bone.parent >= 0 else 0)
    return levels


@lru_cache(maxsize=4)  # a tracker asks for it once per layer
def pack_body(body: BodyModel) -> np.ndarray:
    """Return the table of kinematics.h, float32, read-only.

    It concatenates bones (B, 16), free axes (D, 4) and cones (C, CONE_FLOATS).
    """
    bones: list[np.ndarray] = []
    axes: list[tuple[int, int, int, int]] = []
    for bone, level in zip(body.bones, bone_levels(body), strict=True):
        links = [bone.parent, len(axes), len(bone.axes), level]
        bones.append(np.concatenate([links, bone.rest.ravel(), bone.offset]))
        axes += [(AXES.index(axis.kind), axis.sign, axis.dof, bone.parent) for axis in bone.axes]
    cones = cone_table(body)
    cones[:, _CONE_BONE] = [cone.bone for cone in body.cones]
    tables = (np.array(bones), np.array(axes), cones)
    packed = np.concatenate([table.ravel() for table in tables]).astype(np.float32)
    packed.flags.writeable = False
    return packed
