"""The convex hulls of one camera's silhouettes as rays, their extremes in every frame, and where
cameras see the person."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from psfs.cameras.camera import Camera
from psfs.cameras.triangulation import intersect_rays
from psfs.diagnostics.small_views import Outline


class HullRays:
    """Corners of the hulls of one camera's silhouettes in F frames, one frame's after another's.

    pixels: (N, 2). rows: (N,) the frame of each. starts: (M,) the first of each frame with a
    silhouette. frames: (M,) these frames. at_border: (N,) bool, whether the silhouette may go on
    beyond the picture. camera: small. rays: (N, 3) directions of depth 1 of the pixels in the
    camera's axes.
    """

    def __init__(self, camera: Camera, outlines: Sequence[Outline | None]) -> None:
        traced = [(frame, line) for frame, line in enumerate(outlines) if line is not None]
        self.camera, self.n_frames = camera, len(outlines)
        self.frames = np.array([frame for frame, _ in traced], int)
        self.pixels = np.concatenate([line.points for _, line in traced] or [np.zeros((0, 2))])
        borders = [line.at_border for _, line in traced] or [np.zeros(0, bool)]
        self.at_border = np.concatenate(borders)
        lengths = [len(line.points) for _, line in traced]
        self.rows, self.starts = np.repeat(self.frames, lengths), np.cumsum([0, *lengths])[:-1]

    @cached_property
    def rays(self) -> np.ndarray:
        return self.camera.rays(self.pixels) @ self.camera.R.T

    def extremes(self, values: np.ndarray, widest: float = np.inf) -> np.ndarray:
        """Return the least and the greatest of values (..., N) in every frame (..., F, 2); NaN
        without a silhouette, if they are more than `widest` apart, or if the silhouette may go on
        beyond the picture there."""
        out = np.full((*values.shape[:-1], self.n_frames, 2), np.nan)
        if not values.shape[-1]:
            return out
        least = np.minimum.reduceat(values, self.starts, axis=-1)
        greatest = np.maximum.reduceat(values, self.starts, axis=-1)
        too_wide = greatest - least > widest
        if self.at_border.any():
            bounded = np.where(self.at_border, values, np.inf)
            low = np.minimum.reduceat(bounded, self.starts, axis=-1)
            bounded = np.where(self.at_border, values, -np.inf)
            high = np.maximum.reduceat(bounded, self.starts, axis=-1)
            least = np.where(low <= least, np.nan, least)
            greatest = np.where(high >= greatest, np.nan, greatest)
        ends = np.stack([least, greatest], -1)
        ends[too_wide] = np.nan
        out[..., self.frames, :] = ends
        return out

    def find_extreme_angles(self, forward: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Return `extremes` of the angles, rad, of directions whose parts (..., N) are given."""
        if forward.min(initial=1.0) > 0:  # the tangent rises with the angle and is quicker
            return np.arctan(self.extremes(across / forward))
        return self.extremes(np.arctan2(across, forward))

    def extreme_points(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return `extremes` and the pixels (F, 2, 2) of their corners."""
        ends = self.extremes(values)
        pixels = np.full((self.n_frames, 2, 2), np.nan)
        for side in range(2):
            at = np.nonzero(values == ends[self.rows, side])[0]
            pixels[self.rows[at], side] = self.pixels[at]
        return ends, pixels


def measure_sight(hulls: HullRays) -> np.ndarray:
    """Return the person in one camera (3,): the usual middle x, y at depth 1 and the usual angle,
    rad, between top and bottom; NaN if the camera never shows all of the person."""
    low, high = hulls.extremes(hulls.rays[:, 1]).T
    left, right = hulls.extremes(hulls.rays[:, 0]).T
    rows = np.stack(
        [0.5 * (left + right), 0.5 * (low + high), np.arctan(high) - np.arctan(low)], -1
    )
    known = np.isfinite(rows).all(axis=1)
    return np.median(rows[known], axis=0) if known.any() else np.full(3, np.nan)


def find_person(cameras: Sequence[Camera], sights: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the person's middle (3,), where the directions of the sights (V, 3) meet, and stature,
    in the cameras' unit. NaN if fewer than two cameras show the person wholly."""
    known = np.flatnonzero(np.isfinite(sights).all(axis=1)).tolist()
    if len(known) < 2:
        return np.full(3, np.nan), float("nan")
    centres = np.stack([cameras[view].centre for view in known])
    rays = np.stack([np.append(sights[view, :2], 1) @ cameras[view].R for view in known])
    middle = intersect_rays(centres, rays)
    sizes = np.linalg.norm(centres - middle, axis=1) * sights[known, 2]
    return middle, float(np.median(sizes))
