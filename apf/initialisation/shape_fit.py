"""The body's shape by least squares: bone lengths and radii shared over several frames' clouds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from apf.body.cones import distances, normals
from apf.body.jacobian import point_jacobian
from apf.body.kinematics import posed_cones, posed_joints
from apf.body.model import BodyModel

#: Deviations of the priors, logs of scales: of the whole body's size and girth, and of a bone's
#: length and a part's radius beside it.
SIZE, GIRTH, LENGTH, RADIUS = 0.08, 0.15, 0.025, 0.08
#: Deviation of a known stature, m, and of an angle from rest, rad (only decides what is open).
_STATURE, _ANGLE = 0.005, 1.0
#: What all clouds together count: as many independent distances of this deviation, m. The body is
#: not made of cones, and wrong in the same way in every frame: more frames know no more of it.
_COUNT, _NOISE = 300.0, 0.02
#: Share of the points below the feet or above the head.
_STRAY = 0.002
#: Difference for derivatives; distance between points on the body, m; share of damping.
_STEP, _SPACING, _DAMPING = 1e-5, 0.06, 1e-3


class Shape:
    """The logs of scales of a body: size, girth, lengths per group, radii per group of cones.

    `deviation`: (S,) of the prior around 0.
    """

    def __init__(self, template: BodyModel) -> None:
        self.template = template
        self.lengths = template.scale_groups
        self.radii = template.radius_groups
        self.deviation = np.concatenate(
            [
                [SIZE, GIRTH],
                np.full(len(self.lengths), LENGTH),
                np.full(len(self.radii), RADIUS),
            ]
        )

    def body(self, shape: np.ndarray) -> BodyModel:
        """The template with the scales of `shape` (S,)."""
        n = len(self.lengths)
        lengths = np.exp(shape[0] + shape[2 : 2 + n])
        radii = np.exp(shape[0] + shape[1] + shape[2 + n :])
        return self.template.scaled(
            dict(zip(self.lengths, lengths, strict=True)),
            dict(zip(self.radii, radii, strict=True)),
        )


def stature(body: BodyModel) -> float:
    """Height, m, of the body when it stands upright: top of the head over the lowest cone."""
    pose = np.clip(np.zeros(body.n_dof), body.lower, body.upper)[None]
    cones = posed_cones(body, pose)[0]
    lowest = min((cones[:, 2] - cones[:, 3]).min(), (cones[:, 6] - cones[:, 7]).min())
    top = posed_joints(body, pose)[0, body.joint_names.index("head_top"), 2]
    return float(top - lowest)


@dataclass(frozen=True, eq=False)
class Contacts:
    """Points fixed to cones' surfaces and where they should be.

    cone: (K,) indices. place: (K, 4) share along the axis, then offset from the axis in radii
    along (axis, X, Y). target: (K, 3) m. normal: (K, 3) unit. share: (K,) of the
    cloud's or the body's surface that each stands for. weight: (K,) the share, less with distance.
    """

    cone: np.ndarray
    place: np.ndarray
    target: np.ndarray
    normal: np.ndarray
    weight: np.ndarray
    share: np.ndarray


def placed(place: np.ndarray, cones: np.ndarray) -> np.ndarray:
    """Points (..., K, 3) at `place` (K, 4) of posed cones (..., K, 16)."""
    a, b = cones[..., 0:3], cones[..., 4:7]
    x, y = cones[..., 8:11], cones[..., 12:15]
    t = place[:, 0:1]
    axis = b - a
    radius = cones[..., 3:4] + t * (cones[..., 7:8] - cones[..., 3:4])
    unit = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    offset = place[:, 1:2] * unit
    offset = offset + place[:, 2:3] * x / np.sum(x * x, -1, keepdims=True)
    offset = offset + place[:, 3:4] * y / np.sum(y * y, -1, keepdims=True)
    return a + t * axis + radius * offset


def _places(points: np.ndarray, cones: np.ndarray) -> np.ndarray:
    """(K, 4) surface places nearest to points (K, 3), each on its own cone (K, 16)."""
    axis = cones[:, 4:7] - cones[:, 0:3]
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    offset = points - cones[:, 0:3]
    along = np.sum(offset * axis, 1, keepdims=True) / length
    t = np.clip(along / length, 0, 1)
    beyond = along - t * length
    x = np.sum(offset * cones[:, 8:11], 1, keepdims=True)
    y = np.sum(offset * cones[:, 12:15], 1, keepdims=True)
    local = np.concatenate([beyond, x, y], 1)
    return np.concatenate([t, local / np.maximum(np.linalg.norm(local, axis=1)[:, None], 1e-9)], 1)


def surface_places(body: BodyModel, spacing: float = _SPACING) -> tuple[np.ndarray, np.ndarray]:
    """Cones (K,) and places (K, 4), about `spacing` m apart on all cones and their round ends."""
    cones, places = [], []
    for c, cone in enumerate(body.cones):
        length = float(np.linalg.norm(cone.end - cone.start))
        n = max(2, round(length / spacing))
        rows = [((i + 0.5) / n, 0.0) for i in range(n)]
        rows += [(0.0, -0.5), (1.0, 0.5), (0.0, -1.0), (1.0, 1.0)]
        around = max(6, round(2 * np.pi * np.mean(cone.radii) / spacing))
        for t, cap in rows:
            for angle in np.arange(around if abs(cap) < 1 else 1) * 2 * np.pi / around:
                side = np.sqrt(1 - cap * cap)
                places.append((t, cap, side * np.cos(angle), side * np.sin(angle)))
                cones.append(c)
    return np.array(cones), np.array(places)


class Cloud:
    """Points (N, 3) m of one frame's surface, evenly thinned to `n`, and a search tree of all.

    heights: m, of the lowest and the highest, but for strays.
    """

    def __init__(self, points: np.ndarray, n: int = 800) -> None:
        self.tree = cKDTree(points)
        self.points = points[np.arange(min(n, len(points))) * len(points) // min(n, len(points))]
        self.heights = tuple(np.quantile(points[:, 2], (_STRAY, 1 - _STRAY)))


def contacts(
    cloud: Cloud, cones: np.ndarray, samples: tuple[np.ndarray, np.ndarray], reach: float
) -> Contacts:
    """Both ways: surface voxels to the nearest cone, the cones' free surface to the nearest voxel.

    Weights fall with distance (Geman & McClure 1987, as in refine) and sum to about 1 each way.
    """
    points = cloud.points
    every = distances(points, cones)
    nearest = np.abs(every).argmin(1)
    there = _places(points, cones[nearest])
    cone, place = samples
    own = placed(place, cones[cone])
    depth = distances(own, cones)
    depth[np.arange(len(cone)), cone] = np.inf
    free = depth.min(1) > 0
    cone, place, own = cone[free], place[free], own[free]
    target = cloud.tree.data[cloud.tree.query(own)[1]]
    all_cones = np.concatenate([nearest, cone])
    all_places = np.concatenate([there, place])
    targets = np.concatenate([points, target])
    surface = np.concatenate([placed(there, cones[nearest]), own])
    share = np.concatenate([np.full(len(points), 1 / len(points)), np.full(len(own), 1 / len(own))])
    gap = np.sum((targets - surface) ** 2, 1)
    normal = normals(surface, cones[all_cones])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-9)[:, None]
    weight = share / (1 + gap / reach**2) ** 2
    return Contacts(all_cones, all_places, targets, normal, weight, share)


def fit_shape(
    template: BodyModel,
    clouds: Sequence[Cloud],
    shape: np.ndarray,
    poses: np.ndarray,
    height: float | None = None,
    steps: int = 12,
    reach: tuple[float, float] = (0.08, 0.03),
    free: Sequence[int] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Scales (S,) and poses (M, D) that bring the body onto the clouds of M frames.

    Gauss-Newton over the poses and the scales numbered in `free` (all of them by default); the
    poses are eliminated frame by frame (Schur's complement). height: known stature, m. reach:
    distance at which points count half in the first and in the last step, m.
    """
    model = Shape(template)
    chosen = np.arange(len(shape)) if free is None else np.asarray(free, int)
    more = _STEP * np.eye(len(shape))[chosen]
    prior = model.deviation[chosen] ** -2.0
    loose = _pose_prior(template)
    for width in np.geomspace(*reach, steps):
        body = model.body(shape)
        larger = [model.body(shape + step) for step in more]
        cones = posed_cones(body, poses)
        by_shape = np.stack([posed_cones(other, poses) for other in (body, *larger)], 1)[:, 1:]
        samples = surface_places(body)
        matrix, vector = np.diag(prior), prior * shape[chosen]
        if height is not None:
            miss = stature(body) - height
            row = (np.array([stature(other) for other in larger]) - height - miss) / _STEP
            matrix += np.outer(row, row) / _STATURE**2
            vector += row * miss / _STATURE**2
        solutions = []
        for cloud, pose, mine, grown in zip(clouds, poses, cones, by_shape, strict=True):
            found = contacts(cloud, mine, samples, width)
            normal, gradient = _normal_equations(body, pose, mine, grown, found, len(poses))
            solutions.append(_eliminated(normal, gradient, loose, pose - template.rest_pose))
            n = template.n_dof
            matrix += normal[n:, n:] - normal[n:, :n] @ solutions[-1][:, :-1]
            vector += gradient[n:] - normal[n:, :n] @ solutions[-1][:, -1]
        change = -np.linalg.solve(matrix, vector)
        shape = shape.copy()
        shape[chosen] += change
        moves = np.stack([s[:, :-1] @ change + s[:, -1] for s in solutions])
        poses = np.clip(poses - moves, template.lower, template.upper)
    return shape, poses


def _pose_prior(body: BodyModel) -> np.ndarray:
    """(D,) inverse variances of the angles around rest; the root is free."""
    return np.where(angular(body), _ANGLE**-2, 0.0)


def angular(body: BodyModel) -> np.ndarray:
    """(D,) True for the axes of the bones other than roots."""
    joints = [axis.dof for bone in body.bones if bone.parent >= 0 for axis in bone.axes]
    return np.isin(np.arange(body.n_dof), joints)


def _normal_equations(
    body: BodyModel,
    pose: np.ndarray,
    cones: np.ndarray,
    by_shape: np.ndarray,
    found: Contacts,
    n_frames: int,
) -> tuple[np.ndarray, np.ndarray]:
    """J'J (D + S, D + S) and J'r (D + S,) of the gaps r along the normals, in deviations."""
    here = placed(found.place, cones[found.cone])
    gap = np.sum(found.normal * (here - found.target), 1)
    by_pose = point_jacobian(body, pose, found.cone, here, found.normal)
    rows = np.concatenate([by_pose, _growths(cones, by_shape, found, here)])
    weighted = rows * (found.weight * _COUNT / n_frames / _NOISE**2)
    return weighted @ rows.T, weighted @ gap


def _growths(
    cones: np.ndarray, by_shape: np.ndarray, found: Contacts, here: np.ndarray
) -> np.ndarray:
    """(S, K) how far each scale moves the contacts, at `here` (K, 3), along their normals: the
    ends and radii of cones (S, C, 16) change, not their directions."""
    ends = cones[found.cone]
    t, n = found.place[:, 0:1], found.normal
    outward = here - (1 - t) * ends[:, 0:3] - t * ends[:, 4:7]
    radius = (1 - t) * ends[:, 3:4] + t * ends[:, 7:8]
    along = np.concatenate([n, np.sum(n * outward, 1, keepdims=True) / radius], 1)
    per_end = np.concatenate([(1 - t) * along, t * along], 1)
    change: np.ndarray = (by_shape - cones)[..., :8] / _STEP
    return np.einsum("skj,kj->sk", change[:, found.cone], per_end)


def _eliminated(
    normal: np.ndarray, gradient: np.ndarray, prior: np.ndarray, away: np.ndarray
) -> np.ndarray:
    """(D, S + 1): how the pose answers to each scale, and its own step (both to be subtracted)."""
    n = len(prior)
    own = normal[:n, :n] + np.diag(prior + _DAMPING * np.diag(normal[:n, :n]) + 1.0)
    right = np.concatenate([normal[:n, n:], (gradient[:n] + prior * away)[:, None]], 1)
    return np.linalg.solve(own, right)
