"""Bundle adjustment of cameras, lags and points, each of one keypoint in one frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from psfs.cameras.camera import Camera
from psfs.self_calibration.points.segments import Segments, SegmentTerms

#: Parameters of a camera: rotation vector and shift in its axes, log of the focal length's factor,
#: lag in frames.
N_PARAMETERS = 8
#: Least depth of a point, of the scene's depth; damping at the start, and its least.
_NEAR, _DAMPING, _LEAST_DAMPING = 0.02, 1e-3, 1e-9


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
    total, moment = np.zeros((pixels.shape[1], 3, 3)), np.zeros((pixels.shape[1], 3))
    count = np.zeros(pixels.shape[1], int)
    for camera, own in zip(cameras, pixels, strict=True):
        seen = np.isfinite(own).all(axis=-1)
        local = np.column_stack([own[seen], np.ones(seen.sum())]) @ np.linalg.inv(camera.K).T
        rays = local @ camera.R
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        across = np.eye(3) - rays[:, :, None] * rays[:, None]
        total[seen] += across
        moment[seen] += across @ camera.centre
        count += seen
    out = np.full(moment.shape, np.nan)
    known = count > 1
    ridge = 1e-9 * np.eye(3)
    out[known] = np.linalg.solve(total[known] + ridge, moment[known, :, None])[..., 0]
    return out


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


def robust_weights(errors: np.ndarray, least: float, reach: float) -> np.ndarray:
    """Return Geman and McClure's weights (V, P) of errors (V, P, 2), px; least: of the noise."""
    away = np.linalg.norm(errors, axis=-1)
    noise = max(least, float(np.nanmedian(away)) / 1.1774)  # the median of Rayleigh's distribution
    weights = 1 / (noise * (1 + (away / (reach * noise)) ** 2)) ** 2
    return np.nan_to_num(weights)


def adjust_points(
    scene: PointScene,
    observations: PointObservations,
    sigmas: np.ndarray,
    noise: float,
    reach: float,
    steps: int,
) -> PointScene:
    """Minimise the robust sum of squared reprojection errors over cameras, lags and points.

    sigmas: (V, 8) standard deviations of the cameras' parameters around those of `scene`; 0: kept.
    noise: least standard deviation of an error, px. Levenberg-Marquardt steps with the points
    eliminated (Schur complement; Triggs et al., Bundle Adjustment, 2000).
    """
    start, values = scene, np.zeros(sigmas.shape)
    damping = _DAMPING
    local, errors = project(scene, observations)
    weights = robust_weights(errors, noise, reach)
    for _ in range(steps):
        state = _State(local, errors, weights, _linearise(scene, observations))
        change, moved = _step(scene, observations, state, values, sigmas, damping)
        trial_values = values + change
        trial = _apply(start, scene, change, moved, trial_values)
        trial_local, trial_errors = project(trial, observations)
        behind = (trial_local[..., 2] <= 0) & observations.seen
        before = state.cost(scene, errors) + _prior(values, sigmas)
        worse = state.cost(trial, trial_errors) + _prior(trial_values, sigmas) > before
        if worse or behind[weights > 0].mean() > 0.2:
            damping *= 10
            if damping > 1e6:
                break
            continue
        damping = max(_LEAST_DAMPING, damping / 10)
        done = np.abs(change).max() < 1e-7
        scene, values, local, errors = trial, trial_values, trial_local, trial_errors
        weights = robust_weights(errors, noise, reach)
        if done:
            break
    return scene


@dataclass(frozen=True, eq=False)
class _State:
    """The problem, linearised. local: (V, P, 3) and errors (V, P, 2), see `project`. weights: (V,
    P). segments: None without any."""

    local: np.ndarray
    errors: np.ndarray
    weights: np.ndarray
    segments: SegmentTerms | None

    def cost(self, scene: PointScene, errors: np.ndarray) -> float:
        """Return the weighted sum of squares of a scene with these errors (V, P, 2)."""
        squares = np.nan_to_num(np.square(errors).sum(axis=-1))
        own = 0.0 if self.segments is None else self.segments.cost(scene.points)
        return float((self.weights * squares).sum()) + own


def _linearise(scene: PointScene, observations: PointObservations) -> SegmentTerms | None:
    if observations.segments is None:
        return None
    return observations.segments.linearise(scene.points)


def _prior(values: np.ndarray, sigmas: np.ndarray) -> float:
    free = sigmas > 0
    return float(np.square(values[free] / sigmas[free]).sum())


def _apply(
    start: PointScene, scene: PointScene, change: np.ndarray, moved: np.ndarray, values: np.ndarray
) -> PointScene:
    cameras = []
    for first, camera, own, total in zip(start.cameras, scene.cameras, change, values, strict=True):
        turn = cv2.Rodrigues(own[:3])[0]
        K = first.K.copy()
        K[[0, 1], [0, 1]] *= np.exp(total[6])
        cameras.append(replace(camera, K=K, R=turn @ camera.R, t=turn @ camera.t + own[3:6]))
    return PointScene(tuple(cameras), start.lags + values[:, 7], scene.points + moved)


def _step(
    scene: PointScene, observations: PointObservations, state: _State, values: np.ndarray,
    sigmas: np.ndarray, damping: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return the step of the cameras (V, 8) and of the points (P, 3)."""
    weights = state.weights
    of_camera, of_point = _derivatives(scene, observations, state.local, state.errors)
    of_camera *= sigmas[:, None, None] > 0
    errors = np.nan_to_num(state.errors)
    weighted = of_point * weights[..., None, None]
    right_points = np.einsum("vpri,vpr->pi", weighted, errors)
    blocks = np.einsum("vpri,vprj->pij", weighted, of_point)
    blocks[observations.seen.sum(axis=0) < 2] = 0
    inverse = _invert_points(blocks, right_points, state.segments, damping)
    n, (groups, size) = values.size, inverse.shape[:2]
    cross = np.einsum("vpri,vprj->vipj", of_camera, weighted).reshape(n, groups, size)
    eliminated = np.einsum("ngi,gij->ngj", cross, inverse, optimize=True).reshape(n, -1)
    cross = cross.reshape(n, -1)
    own = np.einsum("vpri,vp,vprj->vij", of_camera, weights, of_camera, optimize=True)
    normal = np.zeros((n, n))
    for view, block in enumerate(own):
        rows = slice(view * N_PARAMETERS, (view + 1) * N_PARAMETERS)
        normal[rows, rows] = block + damping * np.diag(np.diag(block))
    normal -= eliminated @ cross.T
    gradient = np.einsum("vpri,vp,vpr->vi", of_camera, weights, errors, optimize=True).ravel()
    gradient -= eliminated @ right_points.ravel()
    spread = sigmas.ravel()
    with np.errstate(divide="ignore"):
        information = np.where(spread > 0, spread**-2.0, 1.0)
    gradient += np.where(spread > 0, values.ravel() * information, 0.0)
    change = -np.linalg.solve(normal + np.diag(information), gradient)
    pulled = (right_points.ravel() + change @ cross).reshape(groups, size, 1)
    moved: np.ndarray = -(inverse @ pulled).reshape(-1, 3)
    return change.reshape(values.shape), moved


def _invert_points(
    blocks: np.ndarray, gradient: np.ndarray, segments: SegmentTerms | None, damping: float
) -> np.ndarray:
    """Return the inverses (G, N, N) of the points' normal matrices (P, 3, 3), of each point by
    itself or, with segments, which are added to the gradient (P, 3) too, of each frame's together.
    Points with zeros are kept."""
    blocks = blocks + damping * np.eye(3) * np.trace(blocks, axis1=1, axis2=2)[:, None, None] / 3
    known = blocks.any(axis=(1, 2))
    if segments is None:
        inverse = np.zeros_like(blocks)
        inverse[known] = np.linalg.inv(blocks[known] + 1e-12 * np.eye(3))
        return inverse
    count = segments.segments.n_points
    normal = np.zeros((len(blocks) // count, count, 3, count, 3))
    rows = np.arange(count)
    normal[:, rows, :, rows] = blocks.reshape(-1, count, 3, 3).swapaxes(0, 1)
    segments.add(normal, gradient.reshape(-1, count, 3))
    free = np.repeat(known.reshape(-1, count), 3, axis=1)
    flat = normal.reshape(len(normal), 3 * count, 3 * count) * free[:, None] * free[:, :, None]
    flat += np.eye(3 * count) * np.where(free, 1e-9, 1.0)[:, None]
    inverse = np.linalg.inv(flat)
    return inverse * free[:, None] * free[:, :, None]


def _derivatives(
    scene: PointScene, observations: PointObservations, local: np.ndarray, errors: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the derivatives of the errors by the cameras (V, P, 2, 8) and points (V, P, 2, 3);
    zero where a point is not seen."""
    n_views, n_points = local.shape[:2]
    by_local = np.zeros((n_views, n_points, 2, 3))
    focal = np.stack([c.K[[0, 1], [0, 1]] for c in scene.cameras])[:, None]
    inverse = 1 / local[..., 2]
    by_local[..., 0, 0] = focal[..., 0] * inverse
    by_local[..., 1, 1] = focal[..., 1] * inverse
    by_local[..., 2] = -focal * local[..., :2] * inverse[..., None] ** 2
    skew = np.zeros((n_views, n_points, 3, 3))  # of the cross product w x local, by w
    x, y, z = np.moveaxis(local, -1, 0)
    skew[..., 0, 1], skew[..., 0, 2], skew[..., 1, 2] = z, -y, x
    skew -= np.swapaxes(skew, -1, -2).copy()
    of_camera = np.zeros((n_views, n_points, 2, N_PARAMETERS))
    of_camera[..., :3] = by_local @ skew
    of_camera[..., 3:6] = by_local
    of_camera[..., 6] = focal * local[..., :2] * inverse[..., None]
    of_camera[..., 7] = -np.nan_to_num(observations.speeds)
    R = np.stack([c.R for c in scene.cameras])[:, None]
    unseen = ~np.isfinite(errors).all(axis=-1)
    of_point = by_local @ R
    of_camera[unseen], of_point[unseen] = 0, 0
    return of_camera, of_point
