"""Bundle adjustment of cameras, lags and points, each of one keypoint in one frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from psfs.cameras.camera import Camera
from psfs.common.least_squares import Parameters, Residuals, Slope, prior, solve
from psfs.diagnostics.refinement import correct_cameras, measure_points

#: Most steps of an adjustment.
_STEPS = 20
#: Standard deviation of a limb's length from frame to frame, as a share of it.
_RIGID = 0.04


@dataclass(frozen=True, eq=False)
class PointObservations:
    """Points in the pictures of V cameras without distortion and with square pixels.

    pixels: (V, P, 2) px from the principal point; NaN where a point is not seen. speeds: (V, P, 2)
    px per frame. points (P,) are one keypoint at one time each, frame by frame. segments: (F, S, 2)
    int, the points at both ends of what stays as long in F frames.
    """

    pixels: np.ndarray
    speeds: np.ndarray
    segments: np.ndarray

    @property
    def seen(self) -> np.ndarray:
        """Mask (V, P) bool of the points that each camera sees."""
        return np.all(np.isfinite(self.pixels), axis=-1)

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


def measure_errors(scene: PointScene, observations: PointObservations) -> np.ndarray:
    """Return the errors (V, P) px of the points; NaN where they are not seen."""
    errors = np.full(observations.seen.shape, np.nan)
    views, items = np.nonzero(observations.seen)
    pixels, speeds = observations.pixels[views, items], observations.speeds[views, items]
    pixels = pixels + scene.lags[views, None] * speeds
    offsets = measure_points(scene.cameras, views, scene.points[items], pixels, speeds)[0]
    errors[views, items] = np.linalg.norm(offsets, axis=-1)
    return errors


def adjust_points(
    scene: PointScene, observations: PointObservations, sigmas: np.ndarray, noise: float
) -> PointScene:
    """Minimise the robust sum of squared reprojection errors over cameras, lags and points.

    sigmas: (V, 8) standard deviations of the cameras' parameters around those of `scene`; 0: kept.
    noise: least standard deviation of an error, px.
    """
    views, items = np.nonzero(observations.seen & (observations.seen.sum(axis=0) > 1))
    pixels, speeds = observations.pixels[views, items], observations.speeds[views, items]
    spread = np.where(sigmas > 0, sigmas, np.inf)

    def evaluate(parameters: Parameters) -> list[Residuals]:
        changes, points = parameters["cameras"], parameters["points"]
        cameras, lags = correct_cameras(scene.cameras, changes), scene.lags - changes[:, 7]
        moved = pixels + lags[views, None] * speeds
        errors, by_camera, by_point = measure_points(cameras, views, points[items], moved, speeds)
        slopes = [Slope("cameras", views, by_camera), Slope("points", items, by_point)]
        solution = [Residuals(errors, slopes, least=noise), prior("cameras", changes, spread)]
        if observations.segments.size:
            solution.append(_measure_lengths(points, observations.segments))
        return solution

    start = {"cameras": np.zeros(sigmas.shape), "points": scene.points}
    free = {"cameras": sigmas > 0}
    solution = solve(evaluate, start, steps=_STEPS, eliminate=["points"], free=free).parameters
    cameras = correct_cameras(scene.cameras, solution["cameras"])
    return PointScene(cameras, scene.lags - solution["cameras"][:, 7], solution["points"])


def _measure_lengths(points: np.ndarray, segments: np.ndarray) -> Residuals:
    """Return by how much lengths of segments (F, S, 2) between points (P, 3) differ from their
    median, as shares of it."""
    first, second = np.moveaxis(segments, -1, 0)
    apart = points[first] - points[second]
    lengths = np.linalg.norm(apart, axis=-1)
    never = ~np.isfinite(lengths).any(axis=0)
    usual = np.nanmedian(np.where(never, 1.0, lengths), axis=0)
    along = (apart / (lengths * usual)[..., None]).reshape(-1, 1, 3)
    slopes = [Slope("points", first.ravel(), along), Slope("points", second.ravel(), -along)]
    return Residuals((lengths / usual - 1).ravel(), slopes, sigma=_RIGID)
