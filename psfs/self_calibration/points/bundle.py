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
class Segments:
    """Segments between the K points of a frame, whose lengths stay the same in all frames.

    pairs: (S, 2) int, the points at both ends. n_points: K.
    """

    pairs: np.ndarray
    n_points: int

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
        return Residuals((lengths / usual - 1).ravel(), slopes, sigma=_RIGID)


@dataclass(frozen=True, eq=False)
class PointObservations:
    """Points in the pictures of V cameras without distortion and with square pixels.

    pixels: (V, P, 2) px from the principal point; NaN where a point is not seen. speeds: (V, P, 2)
    px per frame. points (P,) are one keypoint at one time each, frame by frame. segments: between
    points of a frame.
    """

    pixels: np.ndarray
    speeds: np.ndarray
    segments: Segments | None = None

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
        if observations.segments is not None:
            solution.append(observations.segments.measure(points))
        return solution

    start = {"cameras": np.zeros(sigmas.shape), "points": scene.points}
    free = {"cameras": sigmas > 0}
    solution = solve(evaluate, start, steps=_STEPS, eliminate=["points"], free=free).parameters
    cameras = correct_cameras(scene.cameras, solution["cameras"])
    return PointScene(cameras, scene.lags - solution["cameras"][:, 7], solution["points"])
