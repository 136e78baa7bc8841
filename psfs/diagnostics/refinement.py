"""Corrections of given cameras and of their times by frontier points of the silhouettes.

A camera is turned, shifted, refocused and moved in time by a little: robust least squares over the
epipolar residuals of all frontier points (see `frontier`), with priors of the size of usual errors.
What silhouettes cannot tell, a motion of the whole scene and its size, is held at what was given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.rig_geometry import intersect_axes_ahead
from psfs.common.least_squares import (
    Parameters,
    Residuals,
    Slope,
    estimate_noise,
    prior,
    solve,
)
from psfs.diagnostics.frontier import FrontierPoints, epipolar_residuals
from psfs.footage.camera_times import INDEPENDENT_SHARE

#: Parameters of a camera's correction: rotation vector in its axes, rad; shift of its centre, m;
#: log of the focal length's factor; offset in time, frames.
N_PARAMETERS = 8
#: Extent of the points around the scene's middle that are held, m, and how firmly, m.
_EXTENT, _HELD = (0.4, 0.4, 0.8), 5e-4
#: Steps after each matching, and uncertainty of the times in the last one, frames.
_STEPS, _TIME = 2, 0.1
#: Least standard deviation of a contour's points, px.
NOISE = 0.3
#: Speed of a tip, px per frame, at which its measurement is worth half of an independent one: one
#: number for all tips would leave times to slow ones, which are many.
_HALF_SPEED = 1.0
#: Least number of measurements per unknown.
_LEAST_ROWS = 4


@dataclass(frozen=True, eq=False)
class RigCorrections:
    """Corrections of V cameras.

    values, sigmas: (V, 8) rotation vector in the camera's axes, rad; shift of the centre, m; log of
    the focal length's factor; offset in time, frames, and their standard deviations. residual: the
    median of the absolute residuals, px. count: number of frontier points.
    """

    values: np.ndarray
    sigmas: np.ndarray
    residual: float
    count: int

    @property
    def offsets(self) -> np.ndarray:
        """Frames by which each camera takes its pictures later than the mean camera (V,)."""
        return self.values[:, 7]

    def apply(self, cameras: Iterable[Camera]) -> CameraRig:
        """Return the corrected cameras."""
        return CameraRig(correct_cameras(cameras, self.values))


def correct_cameras(cameras: Iterable[Camera], corrections: np.ndarray) -> tuple[Camera, ...]:
    """Return the cameras, corrected by (V, 8)."""
    return tuple(correct_camera(*pair) for pair in zip(cameras, corrections, strict=True))


def correct_camera(camera: Camera, correction: np.ndarray) -> Camera:
    """Return the camera, corrected by (8,) as in `RigCorrections`; its time is not the camera's."""
    R = cv2.Rodrigues(correction[:3])[0] @ camera.R
    placed = replace(camera, R=R, t=-R @ (camera.centre + correction[3:6]))
    return placed.refocused(float(np.exp(correction[6])))


def measure_points(
    cameras: Sequence[Camera], views: np.ndarray, points: np.ndarray, pixels: np.ndarray,
    speeds: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Return the errors (M, 2) px of points (M, 3) in the cameras `views` (M,), and their
    derivatives by these cameras' corrections (M, 2, 8) and by the points (M, 2, 3).

    pixels, speeds: (M, 2) where the points are seen, px from the principal point without
    distortion, and their motion, px per frame, by which the pixels were moved to the point's time.
    """
    R = np.stack([camera.R for camera in cameras])[views]
    centres = np.stack([camera.centre for camera in cameras])[views]
    focal = np.array([camera.K[0, 0] for camera in cameras])[views, None]
    local = np.einsum("mij,mj->mi", R, points - centres)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = focal / local[:, 2:]
        seen = scale * local[:, :2]
        by_local = scale[..., None] * np.broadcast_to(np.eye(2, 3), (len(views), 2, 3))
        by_local[..., 2] = -seen / local[:, 2:]
    by_point = by_local @ R
    by_camera = np.concatenate(
        [np.cross(local[:, None], by_local), -by_point, seen[..., None], speeds[..., None]], axis=-1
    )
    return seen - pixels, by_camera, by_point


#: Find the points of given cameras that agree to a number of pixels; the last argument: (V,) frames
#: by which each camera takes its pictures late.
Find = Callable[[Sequence[Camera], float, np.ndarray], FrontierPoints]


@dataclass(frozen=True, eq=False)
class Further:
    """Further measurements of cameras.

    start: blocks of parameters besides those of the cameras, by name; they are eliminated. measure:
    returns the residuals at cameras, offsets (V,) in time, frames, and these parameters.
    """

    start: Parameters
    measure: Callable[[Sequence[Camera], np.ndarray, Parameters], Sequence[Residuals]]


def fit_rig(
    rig: CameraRig, gates: Sequence[float], find: Find, spread: np.ndarray,
    start: np.ndarray | None = None, further: Sequence[Further] = (),
    group: Callable[[FrontierPoints], np.ndarray] | None = None,
) -> RigCorrections | None:  # fmt: skip
    """Return the corrections under which the points that `find` finds fit best.

    None if there are too few. gates: px, one per matching of points; with wider ones times are less
    certain, so that the residuals of fast points count less. spread: (8,) standard deviations of
    the cameras' errors, as in `RigCorrections`; what has none, 0, is held. start: (V, 8), no
    corrections by default. group: numbers (M,) of the groups of points whose noise is estimated
    apart.
    """
    values = np.zeros((len(rig), N_PARAMETERS)) if start is None else start
    free, sizes = np.broadcast_to(spread > 0, values.shape), np.where(spread > 0, spread, np.inf)
    held = measure_scene_motion(rig) / _HELD
    blocks = {name: block for more in further for name, block in more.start.items()}
    for gate in gates:
        points = find(correct_cameras(rig, values), gate, values[:, 7])
        if len(points) < _LEAST_ROWS * values.size:
            return None
        groups = None if group is None else group(points)
        uncertain = _TIME * gate / gates[-1]

        def evaluate(
            parameters: Parameters, points: FrontierPoints = points,
            groups: np.ndarray | None = groups, uncertain: float = uncertain,
        ) -> list[Residuals]:  # fmt: skip
            changes = parameters["cameras"]
            cameras = correct_cameras(rig, changes)
            frontier = _measure_points(cameras, changes[:, 7], points, groups, uncertain)
            residuals = [frontier, prior("cameras", changes, sizes), _hold(held, changes)]
            for more in further:
                residuals += more.measure(cameras, changes[:, 7], parameters)
            return residuals

        solution = solve(
            evaluate, {"cameras": values, **blocks}, steps=_STEPS, eliminate=list(blocks),
            free={"cameras": free},
        )  # fmt: skip
        values = solution.parameters["cameras"]
        blocks = {name: solution.parameters[name] for name in blocks}
    residual = float(np.median(np.abs(solution.residuals[0].values)))
    return RigCorrections(values, solution.sigmas("cameras"), residual, len(points))


def _measure_points(
    cameras: Sequence[Camera], offsets: np.ndarray, points: FrontierPoints,
    groups: np.ndarray | None, uncertain: float,
) -> Residuals:  # fmt: skip
    """Return the residuals of frontier points. A tip that rests shows the same errors of the
    silhouettes in many frames, and so counts less than one that moves."""
    values, slopes = epipolar_residuals(cameras, points, offsets)
    speeds = np.abs(slopes[:, 0, 7])
    rest = INDEPENDENT_SHARE
    noise = estimate_noise(values, groups, NOISE)
    both = [Slope("cameras", points.views[:, k], slopes[:, k, None]) for k in range(2)]
    weights = rest + (1 - rest) * speeds / (speeds + _HALF_SPEED)
    return Residuals(values, both, np.hypot(noise, uncertain * speeds), weights)


def _hold(held: np.ndarray, values: np.ndarray) -> Residuals:
    """Return the residuals that keep what corrections (V, 8) move, by derivatives `held` (8, 8 V),
    in its place."""
    rows = held.reshape(len(held), *values.shape)
    slopes = [
        Slope("cameras", np.full(len(held), view), rows[:, view, None])
        for view in range(len(values))
    ]
    return Residuals(held @ values.ravel(), slopes, sigma=1.0, robust=False)


def measure_scene_motion(rig: CameraRig) -> np.ndarray:
    """Return the derivatives (8, 8 V) of what silhouettes cannot tell by the corrections.

    Points around the scene's middle, triangulated from their pixels in all cameras, move if
    cameras are corrected; of that the translation, m, the rotation and the change of size,
    times the points' mean distance, m, and the cameras' mean offset in time, frames.
    """
    lattice = np.meshgrid(*[(-side, 0, side) for side in _EXTENT])
    away = np.stack(lattice, -1).reshape(-1, 3)
    points, total = intersect_axes_ahead(rig) + away, np.zeros((len(away), 3, 3))
    moves = np.zeros((len(away), 3, len(rig), N_PARAMETERS))
    for view, camera in enumerate(rig):
        ray = points - camera.centre
        distance = np.linalg.norm(ray, axis=1)[:, None, None]
        unit = ray / distance[:, 0]
        across = (np.eye(3) - unit[:, :, None] * unit[:, None]) / distance**2
        total += across
        turned = np.cross(np.eye(3), ray[:, None]) @ camera.R.T
        # A longer focal length draws the ray towards the optical axis.
        axis = camera.R[2]
        refocused = (ray @ axis)[:, None] * axis - ray
        by_centre = np.broadcast_to(np.eye(3), turned.shape)
        changes = np.concatenate([turned, by_centre, refocused[..., None]], -1)
        moves[:, :, view, :7] = across @ changes
    moved = np.linalg.solve(total, moves.reshape(len(away), 3, -1)).reshape(3 * len(away), -1)
    basis = [np.tile(axis, (len(away), 1)) for axis in np.eye(3)]
    basis += [np.cross(axis, away) for axis in np.eye(3)] + [away]
    held = np.linalg.pinv(np.stack([column.ravel() for column in basis], -1)) @ moved
    mean = np.tile(np.eye(N_PARAMETERS)[7] / len(rig), len(rig))
    return np.vstack([held, mean])
