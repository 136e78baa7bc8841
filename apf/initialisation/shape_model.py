"""The body's shape as a vector of scales, and points fixed to the surface of its cones."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from apf.body.kinematics import bone_matrices
from apf.body.model import BodyModel, sideless
from psfs.common.cones import dot

#: Standard deviations of the logs of scales. Size: children, too. Lengths beside the size: those of
#: adults of one stature vary by 3 to 4 % (Gordon et al. 2014, ANSUR II), the size itself is as
#: uncertain. By hand: the girth beside the size, and the radius of a part beside both.
SPREAD = {"size": 0.15, "girth": 0.15, "length": 0.06, "radius": 0.08}


class ShapeModel:
    """The logs of scales (S,) of a body: size, girth, lengths per group, radii per group of cones.

    `deviation`: (S,) standard deviation of the prior around 0. `moves_points`: (S,) bool, the
    scales that move joints and other points of the body; the others are of its thickness.
    `on_bone`: (S, B), those that act on whatever is fixed to a bone.
    """

    def __init__(self, template: BodyModel) -> None:
        self.template = template
        self.lengths = template.scale_groups
        self.radii = template.radius_groups
        counts = {"size": 1, "girth": 1, "length": len(self.lengths), "radius": len(self.radii)}
        self.deviation = np.repeat(list(SPREAD.values()), list(counts.values()))
        of_length = [kind in ("size", "length") for kind in SPREAD]
        self.moves_points = np.repeat(of_length, list(counts.values()))
        bones = np.array([sideless(bone.name) for bone in template.bones])
        cones = np.array([sideless(cone.name) for cone in template.cones])
        n_bones, n_cones = len(bones), len(cones)
        self.on_bone = np.concatenate(
            [
                np.ones((1, n_bones)),
                np.zeros((1, n_bones)),
                np.array(self.lengths)[:, None] == bones,
                np.zeros((len(self.radii), n_bones)),
            ]
        )
        # (S, C): the scales that act on the radii of a cone.
        self._on_radii = np.concatenate(
            [
                np.ones((2, n_cones)),
                np.zeros((len(self.lengths), n_cones)),
                np.array(self.radii)[:, None] == cones,
            ]
        )

    def body(self, shape: np.ndarray) -> BodyModel:
        """Return the template with the scales of `shape` (S,)."""
        n = len(self.lengths)
        lengths = np.exp(shape[0] + shape[2 : 2 + n])
        radii = np.exp(shape[0] + shape[1] + shape[2 + n :])
        return self.template.scaled(
            dict(zip(self.lengths, lengths, strict=True)),
            dict(zip(self.radii, radii, strict=True)),
        )

    def growths(self, body: BodyModel, poses: np.ndarray, cones: np.ndarray) -> np.ndarray:
        """Return the derivatives (M, S, C, 8) of the ends and radii of posed `cones` (M, C, 16)
        with respect to the log of each scale, in poses (M, D). `body` is the template with some
        scales."""
        rotations, origins = bone_matrices(body, poses)
        shifts = shift_bones(body, self.on_bone, rotations)
        bones = [cone.bone for cone in body.cones]
        grown = np.empty((*shifts.shape[:2], len(bones), 8))
        for end in (0, 4):
            fixed = cones[:, :, end : end + 3] - origins[:, bones]
            stretched = self.on_bone[:, bones, None] * fixed[:, None]
            grown[..., end : end + 3] = shifts[:, :, bones] + stretched
            grown[..., end + 3] = self._on_radii * cones[:, None, :, end + 3]
        return grown


def shift_bones(body: BodyModel, on_bone: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """Return the derivatives (M, S, B, 3) of the origins of the bones, with world `rotations` (M,
    B, 3, 3), by the logs of S scales. on_bone: (S, B), those that act on what is fixed to a
    bone."""
    shifts = np.zeros((len(rotations), *on_bone.shape, 3))
    for b, bone in enumerate(body.bones):
        if bone.parent >= 0:
            offset = rotations[:, bone.parent] @ bone.offset
            stretched = on_bone[:, bone.parent, None] * offset[:, None]
            shifts[:, :, b] = shifts[:, :, bone.parent] + stretched
    return shifts


def place_points(cones: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
    """Return the points (..., K, 3) with these cone coordinates (K, 4) on posed cones (..., K, 16).

    Cone coordinates are the share along the axis, then the offset from there in radii along (axis,
    X, Y). They do not change when the cone moves and grows.
    """
    a, b = cones[..., 0:3], cones[..., 4:7]
    x, y = cones[..., 8:11], cones[..., 12:15]
    t = coordinates[:, 0:1]
    axis = b - a
    radius = cones[..., 3:4] + t * (cones[..., 7:8] - cones[..., 3:4])
    along, across, up = (coordinates[:, k] for k in (1, 2, 3))
    offset = (along / np.sqrt(dot(axis, axis)))[..., None] * axis
    offset = offset + (across / dot(x, x))[..., None] * x + (up / dot(y, y))[..., None] * y
    return a + t * axis + radius * offset


def end_displacements(
    cones: np.ndarray, t: np.ndarray, points: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    """Return the displacements (K, 8) along `normal` (K, 3) of points (K, 3), at the shares `t` (K,
    1) along cones (K, 16), per unit of the ends' coordinates and radii."""
    outward = points - (1 - t) * cones[:, 0:3] - t * cones[:, 4:7]
    radius = (1 - t) * cones[:, 3:4] + t * cones[:, 7:8]
    along = np.concatenate([normal, dot(normal, outward)[:, None] / radius], 1)
    return np.concatenate([(1 - t) * along, t * along], 1)


def nearest_coordinates(points: np.ndarray, cones: np.ndarray) -> np.ndarray:
    """Return the cone coordinates (K, 4) of the surface points nearest to points (K, 3), each on
    its own cone (K, 16)."""
    axis = cones[:, 4:7] - cones[:, 0:3]
    length = np.sqrt(dot(axis, axis))
    offset = points - cones[:, 0:3]
    along = dot(offset, axis) / length
    t = np.clip(along / length, 0, 1)
    beyond = along - t * length
    local = np.stack([beyond, dot(offset, cones[:, 8:11]), dot(offset, cones[:, 12:15])], 1)
    local /= np.maximum(np.sqrt(dot(local, local)), 1e-9)[:, None]
    return np.concatenate([t[:, None], local], 1)


@lru_cache(maxsize=8)  # a body is compared with many frames
def surface_samples(body: BodyModel, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Return cones (K,) and cone coordinates (K, 4) of points about `spacing` m apart on all cones
    and their round ends. The arrays are cached: do not write to them."""
    rings, cones = [], []
    for c, cone in enumerate(body.cones):
        length = float(np.linalg.norm(cone.end - cone.start))
        n = max(2, round(length / spacing))
        rows = [((i + 0.5) / n, 0.0) for i in range(n)]
        rows += [(0.0, -0.5), (1.0, 0.5), (0.0, -1.0), (1.0, 1.0)]
        around = max(6, round(np.pi * sum(cone.radii) / spacing))
        rings += [(t, cap, around if abs(cap) < 1 else 1) for t, cap in rows]
        cones += [c] * len(rows)
    t, cap, around = np.array(rings).T
    ring = np.repeat(np.arange(len(rings)), around.astype(int))
    first = np.cumsum(around) - around
    angle = (np.arange(len(ring)) - first[ring]) * 2 * np.pi / around[ring]
    side = np.sqrt(1 - cap[ring] ** 2)
    coordinates = np.stack([t[ring], cap[ring], side * np.cos(angle), side * np.sin(angle)], -1)
    samples = np.array(cones)[ring], coordinates
    for array in samples:
        array.flags.writeable = False
    return samples
