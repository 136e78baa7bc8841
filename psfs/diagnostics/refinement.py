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
from psfs.common.least_squares import LEAST_GROUP, REACH
from psfs.diagnostics.config import AlignmentConfig
from psfs.diagnostics.frontier import (
    FrontierPoints,
    SilhouetteContours,
    epipolar_residuals,
    find_frontier_points,
)
from psfs.diagnostics.small_views import Outline

#: Parameters of a camera's correction: rotation vector in its axes, rad; shift of its centre, m;
#: log of the focal length's factor; offset in time, frames.
N_PARAMETERS = 8
#: Extent of the points around the scene's middle that are held, m, and how firmly, m.
_AROUND, _HELD = (0.4, 0.4, 0.8), 5e-4
#: Matchings of the frontier points, and Gauss-Newton steps after each.
_ROUNDS, _STEPS = 4, 2
#: Greatest change of the speed, px per frame^2, of the tips by which a correction is judged.
_JUDGED_BEND = 1.0


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
        pairs = zip(cameras, self.values, strict=True)
        return CameraRig(tuple(correct_camera(camera, own) for camera, own in pairs))


def correct_camera(camera: Camera, correction: np.ndarray) -> Camera:
    """Return the camera, corrected by (8,) as in `RigCorrections`; its time is not the camera's."""
    R = cv2.Rodrigues(correction[:3])[0] @ camera.R
    K = camera.K.copy()
    K[[0, 0, 1], [0, 1, 1]] *= np.exp(correction[6])
    return replace(camera, K=K, R=R, t=-R @ (camera.centre + correction[3:6]))


#: Find the points of given cameras that agree to a number of pixels, of tips whose speed changes by
#: less than another; the last argument: (V,) frames by which each camera takes its pictures late.
Find = Callable[[Sequence[Camera], float, float, np.ndarray], FrontierPoints]
#: Return the normal matrix (8 V, 8 V) and the gradient (8 V,) of further measurements at given
#: cameras and offsets (V,) in time, frames.
Measure = Callable[[Sequence[Camera], np.ndarray], tuple[np.ndarray, np.ndarray]]


class RigFit:
    """Corrections of a rig to outlines [frame][view] in pictures of its size.

    contours: of each view. find: finds the points instead, without outlines. group: numbers (M,) of
    the groups of points whose noise is estimated apart.
    """

    def __init__(
        self,
        rig: CameraRig,
        outlines: Sequence[Sequence[Outline | None]],
        config: AlignmentConfig | None = None,
        find: Find | None = None,
        group: Callable[[FrontierPoints], np.ndarray] | None = None,
    ) -> None:
        self._group = group
        self.rig, self.config = rig, config or AlignmentConfig()
        self.contours = [SilhouetteContours([row[v] for row in outlines]) for v in range(len(rig))]
        self.scene = scene = intersect_axes_ahead(rig)
        self._search = find or (
            lambda rig, gate, bend, late: find_frontier_points(
                rig, self.contours, scene, gate, bend, late
            )
        )
        self._held = self.scene_moves() / _HELD

    def measure(self, values: np.ndarray, frames: np.ndarray | None = None) -> float:
        """Return the median residual, px, under corrections (V, 8); NaN without points."""
        cameras = self._correct(values)
        points = self._find(values, self.config.gate, _JUDGED_BEND, frames)
        if not len(points):
            return float("nan")
        return float(np.median(np.abs(epipolar_residuals(cameras, points, values[:, 7])[0])))

    def solve(
        self, frames: np.ndarray | None = None, start: np.ndarray | None = None, rounds: int = 0,
        further: Measure | None = None,
    ) -> RigCorrections | None:  # fmt: skip
        """Return the corrections under which the outlines of the frames (F,) bool fit best.

        None if there are too few frontier points. start: (V, 8), no corrections by default. rounds:
        matchings of frontier points, each with a narrower gate; by default the settings' number.
        further: further measurements.
        """
        values = np.zeros((len(self.rig), N_PARAMETERS)) if start is None else start.copy()
        config, rounds = self.config, rounds or _ROUNDS
        for number in range(rounds):
            late = rounds - 1 - number
            points = self._find(values, config.gate * 2.0 ** min(late, 2), config.bend, frames)
            if len(points) < config.least_rows * values.size:
                return None
            for _ in range(_STEPS):
                step, covariance, residuals = self._step(values, points, late, further)
                values = values + step
        sigmas = np.sqrt(np.diag(covariance)).reshape(values.shape)
        return RigCorrections(values, sigmas, float(np.median(np.abs(residuals))), len(points))

    def _correct(self, values: np.ndarray) -> list[Camera]:
        return [correct_camera(camera, own) for camera, own in zip(self.rig, values, strict=True)]

    def _find(
        self, values: np.ndarray, gate: float, bend: float, frames: np.ndarray | None
    ) -> FrontierPoints:
        points = self._search(self._correct(values), gate, bend, values[:, 7])
        return points if frames is None else points.select(frames[points.frames])

    def _step(
        self, values: np.ndarray, points: FrontierPoints, late: int, further: Measure | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the Gauss-Newton step (V, 8), the covariance (8 V, 8 V) and the residuals, px.

        The residuals have Geman & McClure's weights, whose width grows with the points' speed as
        long as the times are not yet known: `late` rounds before the last.
        """
        config, n = self.config, values.size
        cameras = self._correct(values)
        residuals, slopes = epipolar_residuals(cameras, points, values[:, 7])
        by_camera = np.zeros((len(residuals), len(values), N_PARAMETERS))
        rows = np.arange(len(residuals))
        for side in range(2):
            by_camera[rows, points.views[:, side]] = slopes[:, side]
        jacobian = by_camera.reshape(len(residuals), n)
        noise = self._estimate_noise(residuals, points)
        speeds = slopes[:, 0, 7] * min(0.1 + 0.15 * late, 0.4)
        widths = np.hypot(noise, speeds)
        information = self._measure_information(np.abs(slopes[:, 0, 7]))
        weights = information / (widths * (1 + (residuals / (REACH * widths)) ** 2)) ** 2
        turn, shift, focal, time = config.turn, config.shift, config.focal, config.time
        sigmas = np.tile([*3 * [turn], *3 * [shift], focal, time], len(values))
        normal = (jacobian * weights[:, None]).T @ jacobian + np.diag(sigmas**-2.0)
        normal += self._held.T @ self._held
        gradient = jacobian.T @ (weights * residuals) + values.ravel() / sigmas**2
        gradient += self._held.T @ (self._held @ values.ravel())
        if further is not None:
            more, pull = further(cameras, values[:, 7])
            normal, gradient = normal + more, gradient + pull
        covariance = np.linalg.inv(normal)
        return -(covariance @ gradient).reshape(values.shape), covariance, residuals

    def _measure_information(self, speeds: np.ndarray) -> np.ndarray:
        """Return how many independent measurements tips (M,) are that move at speeds (M,) px per
        frame: one that rests shows the same errors of the silhouettes in many frames."""
        rest, half = self.config.information, self.config.half_speed
        return rest + (1 - rest) * speeds / (speeds + half)

    def _estimate_noise(self, residuals: np.ndarray, points: FrontierPoints) -> np.ndarray:
        """Return the standard deviation (M,) px of the points' residuals."""
        size = np.abs(residuals)
        found = np.full(len(size), np.median(size))
        if self._group is not None:
            groups = self._group(points)
            for number in np.unique(groups):
                own = groups == number
                if np.count_nonzero(own) >= LEAST_GROUP:
                    found[own] = np.median(size[own])
        return np.maximum(self.config.noise, 1.4826 * found)

    def scene_moves(self) -> np.ndarray:
        """Return the derivatives (8, 8 V) of what silhouettes cannot tell by the corrections.

        Points around the scene's middle, triangulated from their pixels in all cameras, move if
        cameras are corrected; of that the translation, m, the rotation and the change of size,
        times the points' mean distance, m, and the cameras' mean offset in time, frames.
        """
        lattice = np.meshgrid(*[(-side, 0, side) for side in _AROUND])
        away = np.stack(lattice, -1).reshape(-1, 3)
        points, total = self.scene + away, np.zeros((len(away), 3, 3))
        moves = np.zeros((len(away), 3, len(self.rig), N_PARAMETERS))
        for view, camera in enumerate(self.rig):
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
            own = np.concatenate([turned, by_centre, refocused[..., None]], -1)
            moves[:, :, view, :7] = across @ own
        moved = np.linalg.solve(total, moves.reshape(len(away), 3, -1)).reshape(3 * len(away), -1)
        basis = [np.tile(axis, (len(away), 1)) for axis in np.eye(3)]
        basis += [np.cross(axis, away) for axis in np.eye(3)] + [away]
        held = np.linalg.pinv(np.stack([of.ravel() for of in basis], -1)) @ moved
        mean = np.tile(np.eye(N_PARAMETERS)[7] / len(self.rig), len(self.rig))
        return np.vstack([held, mean])
