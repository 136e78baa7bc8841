"""Fit the body's shape by least squares: bone lengths and radii shared by the clouds of several
frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from apf.body.cones import cone_normals
from apf.body.jacobian import point_jacobian
from apf.body.kinematics import posed_cones
from apf.body.model import BodyModel
from apf.body.stature import ankle_cones, stature
from apf.initialisation.config import ShapeFitConfig
from apf.initialisation.shape_model import (
    ShapeModel,
    inner_axes,
    nearest_coordinates,
    place_points,
    surface_displacements,
    surface_samples,
)
from psfs.common.cones import cone_distances, dot

#: Step of the differences of a log of a scale: small against any scale, large against float64's
#: resolution.
LOG_STEP = 1e-5


class Cloud:
    """Points (N, 3) m of one frame's surface, evenly thinned, and a search tree of all.

    points: (n, 3) the thinned ones. on_floor: whether the person stands on the floor. heights: z,
    m, of the lowest and the highest point of the whole person without outliers; of who stands, the
    floor replaces the lowest, see `StandingConfig`.
    part: the range of heights, as shares, whose points are kept, for a body that models only that
    part of the person.
    """

    def __init__(
        self,
        points: np.ndarray,
        config: ShapeFitConfig | None = None,
        part: tuple[float, float] = (-np.inf, np.inf),
    ) -> None:
        config = config or ShapeFitConfig()
        low, high = np.quantile(points[:, 2], (config.stray, 1 - config.stray))
        self.on_floor = config.standing.stands(float(low))
        low = config.standing.height if self.on_floor else low
        self.heights = float(low), float(high)
        share = (points[:, 2] - low) / max(high - low, 1e-9)
        points = points[(share >= part[0]) & (share <= part[1])]
        n = min(config.n_points, len(points))
        self.tree = scipy.spatial.cKDTree(points)
        self.points = points[np.arange(n) * len(points) // n]


@dataclass(frozen=True, eq=False)
class Contacts:
    """Pairs of points on the cones' surfaces and their targets.

    cone: (K,) indices. coordinates: (K, 4) on it, see `place_points`. target: (K, 3) m. normal: (K,
    3) unit. share: (K,) of the cloud's or the body's surface that each represents. weight: (K,) the
    share, reduced with distance.
    """

    cone: np.ndarray
    coordinates: np.ndarray
    target: np.ndarray
    normal: np.ndarray
    weight: np.ndarray
    share: np.ndarray


def find_contacts(
    cloud: Cloud, cones: np.ndarray, samples: tuple[np.ndarray, np.ndarray], reach: float
) -> Contacts:
    """Pair surface voxels with the nearest cone, and the free surface of the cones with the nearest
    voxel.

    The weights fall with distance (Geman & McClure 1987, as in the refinement) and sum to about 1
    in each direction. reach: m, distance at which the weight of a point falls to a quarter.
    """
    points = cloud.points
    every = cone_distances(points, cones)
    nearest = np.abs(every).argmin(1)
    there = nearest_coordinates(points, cones[nearest])
    cone, coordinates = samples
    own = place_points(cones[cone], coordinates)
    depth = cone_distances(own, cones)
    depth[np.arange(len(cone)), cone] = np.inf
    free = depth.min(1) > 0
    cone, coordinates, own = cone[free], coordinates[free], own[free]
    target = cloud.tree.data[cloud.tree.query(own)[1]]
    all_cones = np.concatenate([nearest, cone])
    all_coordinates = np.concatenate([there, coordinates])
    targets = np.concatenate([points, target])
    surface = np.concatenate([place_points(cones[nearest], there), own])
    share = np.concatenate([np.full(len(points), 1 / len(points)), np.full(len(own), 1 / len(own))])
    gap = dot(targets - surface, targets - surface)
    normal = cone_normals(surface, cones[all_cones])
    normal /= np.maximum(np.sqrt(dot(normal, normal)), 1e-9)[:, None]
    weight = share / (1 + gap / reach**2) ** 2
    return Contacts(all_cones, all_coordinates, targets, normal, weight, share)


def fit_shape(
    template: BodyModel,
    clouds: Sequence[Cloud],
    shape: np.ndarray,
    poses: np.ndarray,
    height: float | None = None,
    *,
    config: ShapeFitConfig | None = None,
    n_steps: int | None = None,
    free: Sequence[int] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate scales (S,) and poses (M, D) that fit the body to the clouds of M frames.

    Gauss-Newton over the poses and the scales numbered in `free` (all of them by default); the
    poses are eliminated frame by frame (Schur complement). height: known stature, m. n_steps: the
    config's by default.
    """
    config = config or ShapeFitConfig()
    chosen = np.arange(len(shape)) if free is None else np.asarray(free, int)
    fit = _ShapeFit(template, clouds, chosen, height, config)
    return fit.run(shape, poses, n_steps or config.n_steps)


class _ShapeFit:
    """The steps of `fit_shape`. chosen: (S',) indices of the free scales."""

    def __init__(
        self,
        template: BodyModel,
        clouds: Sequence[Cloud],
        chosen: np.ndarray,
        height: float | None,
        config: ShapeFitConfig,
    ) -> None:
        self._template, self._clouds, self._chosen = template, clouds, chosen
        self._height, self._config = height, config
        self._model = ShapeModel(template, config.prior)
        self._deviation = self._model.deviation[chosen]
        # Inverse variances of the angles around the rest pose; the root has no prior.
        self._pose_prior = np.where(inner_axes(template), config.prior.angle**-2, 0.0)

    def run(
        self, shape: np.ndarray, poses: np.ndarray, n_steps: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the scales (S,) and poses (M, D) after `n_steps` steps."""
        for reach in np.geomspace(self._config.first_reach, self._config.last_reach, n_steps):
            shape, poses = self.step(shape, poses, reach)
        return shape, poses

    def step(
        self, shape: np.ndarray, poses: np.ndarray, reach: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the scales (S,) and poses (M, D) after one Gauss-Newton step."""
        template, n = self._template, self._template.n_dof
        body = self._model.body(shape)
        cones = posed_cones(body, poses)
        growths = self._model.growths(body, poses, cones)[:, self._chosen]
        samples = surface_samples(body, self._config.spacing)
        ankles = ankle_cones(body)
        matrix, vector = self._shape_prior(shape, body)
        solutions = []
        for cloud, pose, mine, growth in zip(self._clouds, poses, cones, growths, strict=True):
            found = find_contacts(cloud, mine, samples, reach)
            if cloud.on_floor and ankles:
                found = self._standing(found, mine, ankles)
            normal, gradient = self._normal_equations(body, pose, mine, growth, found)
            solutions.append(self._eliminate_pose(normal, gradient, pose - template.rest_pose))
            matrix += normal[n:, n:] - normal[n:, :n] @ solutions[-1][:, :-1]
            vector += gradient[n:] - normal[n:, :n] @ solutions[-1][:, -1]
        change = -np.linalg.solve(matrix, vector)
        shape = shape.copy()
        shape[self._chosen] += change
        moves = np.stack([s[:, :-1] @ change + s[:, -1] for s in solutions])
        return shape, np.clip(poses - moves, template.lower, template.upper)

    def _standing(self, found: Contacts, cones: np.ndarray, ankles: dict[int, float]) -> Contacts:
        """Return `found` with an added contact between the lower ankle and its height above the
        floor."""
        config, standing = self._config, self._config.standing
        above = {c: cones[c, 6] - standing.height - height for c, height in ankles.items()}
        lower = min(above, key=lambda c: above[c])
        gap = above[lower]
        # The contact's weight that gives it the standard deviation of an ankle's height.
        weight = len(self._clouds) * (config.noise / standing.ankle) ** 2 / config.n_distances
        weight /= (1 + (gap / standing.lifted) ** 2) ** 2
        up, end = np.array([0.0, 0.0, 1.0]), cones[lower, 4:7]
        return Contacts(
            np.append(found.cone, lower),
            np.vstack([found.coordinates, [1.0, 0.0, 0.0, 0.0]]),
            np.vstack([found.target, end - gap * up]),
            np.vstack([found.normal, up]),
            np.append(found.weight, weight),
            np.append(found.share, 0.0),
        )

    def _shape_prior(self, shape: np.ndarray, body: BodyModel) -> tuple[np.ndarray, np.ndarray]:
        """Return J'J (S', S') and J'r (S',) of the prior and of the known stature."""
        prior = self._deviation**-2.0
        matrix, vector = np.diag(prior), prior * shape[self._chosen]
        if self._height is not None:
            miss = stature(body) - self._height
            steps = LOG_STEP * np.eye(len(shape))[self._chosen]
            grown = np.array([stature(self._model.body(shape + step)) for step in steps])
            row = (grown - self._height - miss) / LOG_STEP
            matrix += np.outer(row, row) / self._config.prior.stature**2
            vector += row * miss / self._config.prior.stature**2
        return matrix, vector

    def _normal_equations(
        self,
        body: BodyModel,
        pose: np.ndarray,
        cones: np.ndarray,
        growth: np.ndarray,
        found: Contacts,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return J'J (D + S', D + S') and J'r (D + S',) of the gaps r along the normals, in
        standard deviations."""
        here = place_points(cones[found.cone], found.coordinates)
        gap = dot(found.normal, here - found.target)
        by_pose = point_jacobian(body, pose, found.cone, here, found.normal)
        by_shape = surface_displacements(cones, growth, found.cone, found.coordinates, found.normal)
        rows = np.concatenate([by_pose, by_shape])
        config = self._config
        weighted = rows * (found.weight * config.n_distances / len(self._clouds) / config.noise**2)
        return weighted @ rows.T, weighted @ gap

    def _eliminate_pose(
        self, normal: np.ndarray, gradient: np.ndarray, away: np.ndarray
    ) -> np.ndarray:
        """Eliminate the pose. Return (D, S' + 1): its response to each scale, and its own step
        (both to be subtracted)."""
        prior, n = self._pose_prior, len(self._pose_prior)
        damping = self._config.damping * np.diag(normal[:n, :n])
        own = normal[:n, :n] + np.diag(prior + damping + 1.0)
        right = np.concatenate([normal[:n, n:], (gradient[:n] + prior * away)[:, None]], 1)
        return np.linalg.solve(own, right)
