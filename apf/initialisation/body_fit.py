"""Fit a body's scales and poses to what is observed of it, by least squares.

The unknowns are the poses of M frames and, shared by all frames, the scales of a `ShapeModel` and
the places of observed points on the body. Every kind of evidence adds residuals with their slopes;
the poses are eliminated frame by frame (Schur complement, Triggs et al. 2000). Evidence of any kind
errs alike in all frames, since people are no cones and networks have habits of their own: together
the frames count as `_INDEPENDENT_FRAMES` observations of what they share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import scipy

from apf.body.cones import cone_normals
from apf.body.jacobian import bone_point_jacobian, cone_motions, cross_rows, world_axes
from apf.body.kinematics import bone_matrices, posed_cones
from apf.body.limbs import root_mask
from apf.body.model import BodyModel, sideless
from apf.body.stature import ankle_cones, stature
from apf.initialisation.shape_model import (
    ShapeModel,
    end_displacements,
    nearest_coordinates,
    place_points,
    shift_bones,
    surface_samples,
)
from psfs.cameras.camera import CameraRig
from psfs.common.cones import cone_distances, dot
from psfs.common.least_squares import (
    REACH,
    Parameters,
    Residuals,
    Slope,
    differentiate,
    prior,
    solve,
)
from psfs.common.progress import one_blas_thread

#: Independent frames, and independent distances of a frame's surface voxels and of its body.
_INDEPENDENT_FRAMES, _INDEPENDENT_DISTANCES = 2.0, 20.0
#: Least standard deviation, m, of a distance: half a voxel.
_LEAST_NOISE = 0.01
#: Points of a cloud that are compared with the body, and distance, m, between those on the body.
_CLOUD_POINTS, _SPACING = 400, 0.08
#: Heights, m, of somebody's lowest voxels who stands on the floor, z = 0: feet and shins may be
#: missing in silhouettes, which say little of shoes, and hulls are thicker than people.
_STANDING = (-0.1, 0.3)
#: Standard deviation, m, of the height of a standing foot's ankle; height of a foot at which it
#: counts a quarter.
_ANKLE, _LIFTED = 0.012, 0.1
#: Standard deviation, m, of a known stature; rad, of an angle from rest.
_STATURE, _ANGLE = 0.001, 1.0


class Cloud:
    """Points of one frame's surface, evenly thinned, (n, 3) m, and a search tree of all of them.

    on_floor: whether the person stands on the floor, z = 0. heights: z, m, of the lowest and the
    highest point of the whole person; the floor's, if they stand on it. part: the range of heights,
    as shares, whose points are kept, for a body that models only that part of the person.
    """

    def __init__(self, points: np.ndarray, part: tuple[float, float] = (-np.inf, np.inf)) -> None:
        low, high = points[:, 2].min(), points[:, 2].max()
        self.on_floor = bool(_STANDING[0] < low < _STANDING[1])
        low = 0.0 if self.on_floor else low
        self.heights = float(low), float(high)
        share = (points[:, 2] - low) / max(high - low, 1e-9)
        points = points[(share >= part[0]) & (share <= part[1])]
        n = min(_CLOUD_POINTS, len(points))
        self.tree = scipy.spatial.cKDTree(points)
        self.points = points[np.arange(n) * len(points) // n]


@dataclass(frozen=True, eq=False)
class Fitted:
    """Scales (S,) of a `ShapeModel`, poses (M, D), and offsets (Q, 3) m of observed points from
    where they are expected on the body."""

    shape: np.ndarray
    poses: np.ndarray
    offsets: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def parameters(self) -> Parameters:
        return {"shape": self.shape[None], "poses": self.poses, "offsets": self.offsets}


class Evidence(Protocol):
    """What is observed of a body in M frames."""

    def residuals(self, model: ShapeModel, at: Fitted) -> list[Residuals]:
        """Return the residuals of a fit, with slopes by the blocks of `Fitted.parameters`."""
        ...


def fit_body(
    model: ShapeModel,
    evidence: Evidence,
    start: Fitted,
    *,
    free: np.ndarray,
    height: float | None = None,
    steps: int = 15,
) -> Fitted:
    """Return the fit of a body to the evidence, from a `start` on.

    free: (S,) bool, the scales that are estimated. height: known stature, m. steps: at most so many
    of the Levenberg-Marquardt method.
    """
    template = model.template
    share = max(1.0, len(start.poses) / _INDEPENDENT_FRAMES) ** -0.5
    angle = np.where(root_mask(template), np.inf, _ANGLE)

    def measure_stature(shapes: np.ndarray) -> np.ndarray:
        return np.array([[stature(model.body(shape))] for shape in shapes])

    def evaluate(at: Parameters) -> list[Residuals]:
        fitted = Fitted(at["shape"][0], at["poses"], at["offsets"])
        found = evidence.residuals(model, fitted)
        found.append(prior("shape", at["shape"], share * model.deviation))
        found.append(prior("poses", at["poses"], angle, template.rest_pose))
        if height is not None:
            (slope,) = differentiate(measure_stature, at["shape"])
            miss, sigma = measure_stature(at["shape"]) - height, share * _STATURE
            by_shape = [Slope("shape", np.zeros(1, int), slope)]
            found.append(Residuals(miss, by_shape, sigma=sigma, robust=False))
        if isinstance(evidence, PointEvidence):
            found.append(prior("offsets", at["offsets"], share * evidence.spread))
        return found

    def move(at: Parameters, step: Parameters) -> Parameters:
        moved = {name: values + step[name] for name, values in at.items()}
        return moved | {"poses": np.clip(moved["poses"], template.lower, template.upper)}

    with one_blas_thread():  # the products are small: BLAS threads would only wait for each other
        solution = solve(
            evaluate, start.parameters, steps=steps, eliminate=["poses"],
            free={"shape": free[None]}, update=move,
        )  # fmt: skip
    found = solution.parameters
    return Fitted(found["shape"][0], found["poses"], found["offsets"])


@dataclass(frozen=True, eq=False)
class SurfaceEvidence:
    """The clouds of M frames: their points touch the body, and its surface touches them."""

    clouds: Sequence[Cloud]

    def residuals(self, model: ShapeModel, at: Fitted) -> list[Residuals]:
        body = model.body(at.shape)
        cones = posed_cones(body, at.poses)
        frame, cone, coordinates, target, share = self.find_contacts(model.template, cones)
        nearest = cones[frame, cone]
        here = place_points(nearest, coordinates)
        normal = cone_normals(here, nearest)
        normal /= np.maximum(np.sqrt(dot(normal, normal)), 1e-9)[:, None]
        ends = end_displacements(nearest, coordinates[:, :1], here, normal)
        through = _move_cones(model, body, at.poses, cones)
        touching = Residuals(
            dot(normal, here - target),
            [_touch(frame * cones.shape[1] + cone, here, normal, ends)],
            weights=_INDEPENDENT_DISTANCES * share, least=_LEAST_NOISE, through=through,
        )  # fmt: skip
        return [touching, *self._stand(body, cones, through)]

    def _stand(
        self, body: BodyModel, cones: np.ndarray, through: Sequence[Slope]
    ) -> list[Residuals]:
        """Return the heights of the lower ankles of who stands above those of an upright body.
        through: see `_move_cones`."""
        ankles = ankle_cones(body)
        standing = np.flatnonzero([cloud.on_floor for cloud in self.clouds] if ankles else [])
        if not len(standing):
            return []
        above = cones[standing][:, list(ankles), 6] - np.array(list(ankles.values()))
        lower = np.array(list(ankles))[above.argmin(1)]
        up, ends = np.eye(3)[np.full(len(standing), 2)], np.eye(8)[np.full(len(standing), 6)]
        key = standing * cones.shape[1] + lower
        sigma = _LIFTED / REACH
        return [
            Residuals(
                above.min(1), [_touch(key, cones[standing, lower, 4:7], up, ends)],
                sigma=sigma, weights=(sigma / _ANKLE) ** 2, through=through,
            )
        ]  # fmt: skip

    def find_contacts(
        self, template: BodyModel, cones: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Pair surface voxels with the nearest of the posed cones (M, C, 16), and the free surface
        of the cones with the nearest voxel.

        Return the frame and the cone (K,) of each pair, the coordinates (K, 4) on it, see
        `place_points`, the voxel (K, 3) m, NaN for points of the body's surface that are not free,
        and the share (K,) of the cloud or of the body's surface in this frame that it stands for.
        """
        points = np.concatenate([cloud.points for cloud in self.clouds])
        counts = np.array([len(cloud.points) for cloud in self.clouds])
        frame, column = np.repeat(np.arange(len(counts)), counts), _count_up(counts)
        padded = np.zeros((len(counts), counts.max(initial=0), 3))
        padded[frame, column] = points
        nearest = np.abs(cone_distances(padded, cones)).argmin(-1)[frame, column]
        there = nearest_coordinates(points, cones[frame, nearest])
        cone, coordinates = surface_samples(template, _SPACING)
        own = place_points(cones[:, cone], coordinates)
        depth = cone_distances(own, cones)
        depth[:, np.arange(len(cone)), cone] = np.inf
        free, target = depth.min(-1) > 0, np.full(own.shape, np.nan)
        for cloud, mine, outside, found in zip(self.clouds, own, free, target, strict=True):
            found[outside] = cloud.tree.data[cloud.tree.query(mine[outside])[1]]
        shown, sample = np.divmod(np.arange(free.size), len(cone))
        return (
            np.concatenate([frame, shown]),
            np.concatenate([nearest, cone[sample]]),
            np.concatenate([there, coordinates[sample]]),
            np.concatenate([points, target.reshape(-1, 3)]),
            np.concatenate([1 / counts[frame], 1 / np.maximum(free.sum(1), 1)[shown]]),
        )


def _count_up(counts: np.ndarray) -> np.ndarray:
    """Return 0, 1, ... of each of some `counts`, one after the other."""
    return np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)


def _touch(key: np.ndarray, points: np.ndarray, normal: np.ndarray, ends: np.ndarray) -> Slope:
    """Return how points (K, 3) on cones of the numbers `key` (K,) move along `normal` (K, 3) with
    the coordinates of `_move_cones`. ends: (K, 8), see `end_displacements`."""
    rows = np.concatenate([normal, cross_rows(points, normal), ends], axis=1)
    return Slope("cones", key, rows[:, None])


def _move_cones(
    model: ShapeModel, body: BodyModel, poses: np.ndarray, cones: np.ndarray
) -> list[Slope]:
    """Return how poses (M, D) and the scales move the `cones` (M, C, 16): their motion, see
    `cone_motions`, and the growth of their ends and radii, 14 coordinates of each."""
    moves = cone_motions(body, world_axes(body, poses)).swapaxes(2, 3)
    growths = np.moveaxis(model.growths(body, poses, cones), 1, 3)
    by_pose = np.pad(moves, [(0, 0), (0, 0), (0, 8), (0, 0)]).reshape(-1, 14, moves.shape[3])
    by_shape = np.pad(growths, [(0, 0), (0, 0), (6, 0), (0, 0)]).reshape(-1, 14, growths.shape[3])
    frames = np.repeat(np.arange(len(poses)), cones.shape[1])
    return [Slope("poses", frames, by_pose), Slope("shape", 0 * frames, by_shape)]


@dataclass(frozen=True, eq=False)
class PointEvidence:
    """P points fixed to the body, seen in M frames: in space, or in the pictures of V cameras.

    bone: (P,) that each is fixed to. position: (P, 3) m on it, in the template's size. partner:
    (P,) index of the same point on the other side, its own on the midline; partners lie at mirrored
    positions. spreads: (P,) m, standard deviation of each coordinate of the position. places:
    (M, P, 3) m, NaN where unknown, with an error of `noise` m, by default estimated; robust:
    whether some may be wrong. pixels: (V, M, P, 2) undistorted in the pictures of `rig`, which take
    the place of `places`, with errors (V, M, P) px, infinite where a point is not seen.
    """

    bone: np.ndarray
    position: np.ndarray
    partner: np.ndarray
    spreads: np.ndarray
    places: np.ndarray
    noise: float | None = None
    robust: bool = True
    rig: CameraRig | None = None
    pixels: np.ndarray | None = None
    errors: np.ndarray | None = None

    @property
    def mirrors(self) -> tuple[np.ndarray, np.ndarray]:
        """The number (P,) of each point's offset, which partners share, and its signs (P, 3)."""
        first = np.minimum(np.arange(len(self.bone)), self.partner)
        offsets = np.unique(first, return_inverse=True)[1]
        signs = np.ones((len(first), 3))
        signs[first != np.arange(len(first)), 1] = -1
        return offsets, signs

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation (Q, 1) m of the offsets."""
        number = self.mirrors[0]
        return (np.bincount(number, self.spreads) / np.bincount(number))[:, None]

    def positions(self, model: ShapeModel, at: Fitted) -> np.ndarray:
        """Return the positions (P, 3) m of the points on their bones."""
        groups = model.template.scale_groups
        group = np.array([groups.index(sideless(bone.name)) for bone in model.template.bones])
        scale = np.exp(at.shape[0] + at.shape[2 : 2 + len(groups)])[group[self.bone]]
        number, signs = self.mirrors
        placed: np.ndarray = self.position * scale[:, None] + signs * at.offsets[number]
        return placed

    def locate(self, model: ShapeModel, at: Fitted) -> np.ndarray:
        """Return the points (M, P, 3) m in the world."""
        rotations, origins = bone_matrices(model.body(at.shape), at.poses)
        turned = rotations[:, self.bone] @ self.positions(model, at)[:, :, None]
        return origins[:, self.bone] + turned[..., 0]

    def residuals(self, model: ShapeModel, at: Fitted) -> list[Residuals]:
        points = self.locate(model, at)
        n_frames, n_points = points.shape[:2]
        body = model.body(at.shape)
        number, signs = self.mirrors
        rotations = bone_matrices(body, at.poses)[0]
        turned, offset = rotations[:, self.bone], signs * at.offsets[number]
        growing = turned @ (self.positions(model, at) - offset)[:, :, None]
        by_pose = bone_point_jacobian(body, at.poses, self.bone, points).swapaxes(2, 3)
        shifts = shift_bones(body, model.on_bone, rotations)[:, :, self.bone]
        by_shape = shifts + model.on_bone[:, self.bone, None] * growing[:, None, :, :, 0]
        by_offset = turned * signs[:, None]
        frame, point = np.divmod(np.arange(n_frames * n_points), n_points)
        slopes = [
            Slope(name, items, values.reshape(len(frame), 3, -1))
            for name, items, values in (
                ("poses", frame, by_pose),
                ("shape", 0 * frame, np.moveaxis(by_shape, 1, 3)),
                ("offsets", number[point], by_offset),
            )
        ]
        if self.pixels is None:
            return [
                Residuals(
                    (points - self.places).reshape(-1, 3),
                    slopes,
                    sigma=self.noise,
                    robust=self.robust,
                )
            ]
        return self._project(points.reshape(-1, 3), slopes)

    def _project(self, points: np.ndarray, slopes: Sequence[Slope]) -> list[Residuals]:
        """Return the residuals, px, of the points (K, 3) in the pictures."""
        assert self.rig is not None and self.pixels is not None and self.errors is not None
        found = []
        for camera, pixels, errors in zip(self.rig, self.pixels, self.errors, strict=True):
            seen = np.flatnonzero(np.isfinite(errors.ravel()))
            sigma = errors.ravel()[seen]
            local = points[seen] @ camera.R.T + camera.t
            depth = np.maximum(local[:, 2:], 0.05)
            plane = local[:, :2] / depth
            gap = plane @ camera.K[:2, :2].T + camera.K[:2, 2] - pixels.reshape(-1, 2)[seen]
            turned = camera.R[:2] - plane[:, :, None] * camera.R[2]
            by_point = camera.K[:2, :2] @ (turned / depth[:, :, None])
            by = [Slope(of.name, of.items[seen], by_point @ of.values[seen]) for of in slopes]
            found.append(Residuals(gap, by, sigma=sigma))
        return found

    def missed_shares(self, model: ShapeModel, at: Fitted) -> tuple[np.ndarray, np.ndarray]:
        """Return the lengths (V, M, P) px of the reprojection residuals, NaN where a point is not
        seen, and the share (M,) of the sightings that each frame's pose misses."""
        assert self.errors is not None
        lengths = np.full(self.errors.shape, np.nan)
        found = self._project(self.locate(model, at).reshape(-1, 3), ())
        for view, of in enumerate(found):
            lengths[view][np.isfinite(self.errors[view])] = np.linalg.norm(of.values, axis=1)
        square = (lengths / self.errors) ** 2
        return lengths, np.nanmean(square / (square + REACH**2), axis=(0, 2))
