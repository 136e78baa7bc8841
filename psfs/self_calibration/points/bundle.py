"""Bundle adjustment of cameras, lags and points, each of one keypoint in one frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from psfs.cameras.camera import Camera
from psfs.cameras.triangulation import intersect_rays
from psfs.common.least_squares import Parameters, Residuals, Slope, prior, solve
from psfs.diagnostics.refinement import N_PARAMETERS

#: Most steps of an adjustment.
_STEPS = 20


@dataclass(frozen=True, eq=False)
class Segments:
    """Segments between the K points of a frame, whose lengths stay the same in all frames.

    pairs: (S, 2) int, the points at both ends. n_points: K. spread: standard deviation of a length,
    as a share of it.
    """

    pairs: np.ndarray
    n_points: int
    spread: float

    def measure(self, points: np.ndarray) -> Residuals:
        """Return by how much lengths between points (F K, 3) differ from their median, as shares
        of it."""
        first = np.arange(0, len(points), self.n_points)[:, None]
        ends = [(first + self.pairs[:, side]) for side in range(2)]
        apart = points[ends[0]] - points[ends[1]]
        lengths = np.linalg.norm(apart, axis=-1)
        known = np.isfinite(lengths)
        never = ~known.any(axis=0)
        usual = np.nanmedian(np.where(never, 1.0, lengths), axis=0)
        along = (apart / (lengths * usual)[..., None]).reshape(-1, 1, 3)
        slopes = [Slope("points", ends[0].ravel(), along), Slope("points", ends[1].ravel(), -along)]
        return Residuals((lengths / usual - 1).ravel(), slopes, sigma=self.spread)


@dataclass(frozen=True, eq=False)
class PointObservations:
    """Points in the pictures of V cameras without distortion.

    pixels: (V, P, 2) px; NaN where a point is not seen. speeds: (V, P, 2) px per frame. points
    (P,) are one keypoint at one time each, frame by frame. segments: between points of a frame.
    """

    pixels: np.ndarray
    speeds: np.ndarray
    segments: Segments | None = None

    @property
    def seen(self) -> np.ndarray:
        """Mask (V, P) bool of the points that each camera sees."""
        return np.isfinite(self.pixels).all(axis=-1)

    def select(self, views: Sequence[int]) -> PointObservations:
        """Return those of some of the cameras."""
        rows = list(views)
        return PointObservations(self.pixels[rows], self.speeds[rows], self.segments)


@dataclass(frozen=True, eq=False)
class PointScene:
    """Cameras without distortion, their lags (V,) in frames and the points (P, 3); NaN where less
    than two cameras see one."""

    cameras: tuple[Camera, ...]
    lags: np.ndarray
    points: np.ndarray


def triangulate_rays(cameras: Sequence[Camera], pixels: np.ndarray) -> np.ndarray:
    """Return the points (P, 3) nearest to the rays of their pixels (V, P, 2) in all cameras; NaN
    where less than two see one."""
    rays = [
        np.concatenate([own, np.ones((len(own), 1))], axis=1) @ np.linalg.inv(camera.K).T @ camera.R
        for camera, own in zip(cameras, pixels, strict=True)
    ]
    centres = np.stack([camera.centre for camera in cameras])
    return intersect_rays(centres, np.stack(rays, axis=1))


def project(scene: PointScene, observations: PointObservations) -> tuple[np.ndarray, np.ndarray]:
    """Return the points in the cameras' axes (V, P, 3) and their errors (V, P, 2), px; NaN where
    they are not seen."""
    local = np.stack([scene.points @ c.R.T + c.t for c in scene.cameras])
    K = np.stack([c.K for c in scene.cameras])
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = local[..., :2] / local[..., 2:]
    focal, middle = K[:, [0, 1], [0, 1]][:, None], K[:, :2, 2][:, None]
    moved = observations.pixels + scene.lags[:, None, None] * observations.speeds
    return local, focal * flat + middle - moved


def adjust_points(
    scene: PointScene, observations: PointObservations, sigmas: np.ndarray, noise: float
) -> PointScene:
    """Minimise the robust sum of squared reprojection errors over cameras, lags and points.

    sigmas: (V, 8) standard deviations of the cameras' parameters around those of `scene`; 0: kept.
    noise: least standard deviation of an error, px.
    """
    items = np.arange(len(scene.cameras)), np.arange(len(scene.points))
    views, rows = (of.ravel() for of in np.meshgrid(*items, indexing="ij"))
    enough = observations.seen.sum(axis=0) > 1
    spread = np.where(sigmas > 0, sigmas, np.inf)

    def evaluate(parameters: Parameters) -> list[Residuals]:
        moved = _build(scene, parameters)
        local, errors = project(moved, observations)
        errors = np.where(enough[:, None], errors, np.nan)
        by_camera, by_point = _differentiate(moved, observations, local)
        slopes = [
            Slope("cameras", views, by_camera.reshape(-1, 2, N_PARAMETERS)),
            Slope("points", rows, by_point.reshape(-1, 2, 3)),
        ]
        found = [
            Residuals(errors.reshape(-1, 2), slopes, least=noise),
            prior("cameras", parameters["cameras"], spread),
        ]
        if observations.segments is not None:
            found.append(observations.segments.measure(moved.points))
        return found

    start = {
        "cameras": np.zeros(sigmas.shape),
        "R": np.stack([camera.R.ravel() for camera in scene.cameras]),
        "t": np.stack([camera.t for camera in scene.cameras]),
        "points": scene.points,
    }
    held = {name: np.zeros(start[name].shape, bool) for name in ("R", "t")}
    free = held | {"cameras": sigmas > 0}
    found = solve(evaluate, start, steps=_STEPS, eliminate=["points"], free=free, update=_update)
    return _build(scene, found.parameters)


def _update(parameters: Parameters, step: Parameters) -> dict[str, np.ndarray]:
    """Turn and shift cameras in their own axes; the rest adds up."""
    turns = np.stack([cv2.Rodrigues(of)[0] for of in step["cameras"][:, :3]])
    R = turns @ parameters["R"].reshape(-1, 3, 3)
    t = np.einsum("vij,vj->vi", turns, parameters["t"]) + step["cameras"][:, 3:6]
    moved = {name: parameters[name] + step[name] for name in ("cameras", "points")}
    return {**moved, "R": R.reshape(-1, 9), "t": t}


def _build(start: PointScene, parameters: Parameters) -> PointScene:
    """Return the scene of parameters around those of `start`."""
    cameras = []
    for camera, values, R, t in zip(
        start.cameras, parameters["cameras"], parameters["R"], parameters["t"], strict=True
    ):
        K = camera.K.copy()
        K[[0, 1], [0, 1]] *= np.exp(values[6])
        cameras.append(replace(camera, K=K, R=R.reshape(3, 3), t=t))
    lags = start.lags + parameters["cameras"][:, 7]
    return PointScene(tuple(cameras), lags, parameters["points"])


def _differentiate(
    scene: PointScene, observations: PointObservations, local: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the derivatives of the errors by the cameras (V, P, 2, 8) and points (V, P, 2, 3)."""
    by_local = np.zeros((*local.shape[:2], 2, 3))
    focal = np.stack([c.K[[0, 1], [0, 1]] for c in scene.cameras])[:, None]
    inverse = 1 / local[..., 2]
    by_local[..., 0, 0] = focal[..., 0] * inverse
    by_local[..., 1, 1] = focal[..., 1] * inverse
    by_local[..., 2] = -focal * local[..., :2] * inverse[..., None] ** 2
    by_camera = np.concatenate(
        [
            np.cross(local[..., None, :], by_local),
            by_local,
            (focal * local[..., :2] * inverse[..., None])[..., None],
            -np.nan_to_num(observations.speeds)[..., None],
        ],
        axis=-1,
    )
    R = np.stack([c.R for c in scene.cameras])[:, None]
    return by_camera, by_local @ R
