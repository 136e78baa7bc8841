"""The convex hulls of one camera's silhouettes as rays, and their extremes in every frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psfs.cameras.camera import Camera
from psfs.diagnostics.small_views import Outline


class HullPoints:
    """Corners of the hulls of one camera's silhouettes in F frames, one frame's after another's.

    pixels: (N, 2). starts: (M,) the first of each frame with a silhouette. frames: (M,) these
    frames. at_border: (N,) bool, whether the silhouette may go on beyond the picture.
    """

    def __init__(self, outlines: Sequence[Outline | None]) -> None:
        found = [(number, of) for number, of in enumerate(outlines) if of is not None]
        self.n_frames = len(outlines)
        self.frames = np.array([number for number, _ in found], int)
        self.pixels = np.concatenate([of.points for _, of in found] or [np.zeros((0, 2))])
        borders = [of.at_border for _, of in found] or [np.zeros(0, bool)]
        self.at_border = np.concatenate(borders)
        self.starts = np.cumsum([0, *(len(of.points) for _, of in found)])[:-1]

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
        found = np.stack([least, greatest], -1)
        found[too_wide] = np.nan
        out[..., self.frames, :] = found
        return out


class HullRays(HullPoints):
    """The same with rays through the corners.

    camera: small. rays: (N, 3) directions of depth 1 in the camera's axes.
    """

    def __init__(self, camera: Camera, outlines: Sequence[Outline | None]) -> None:
        super().__init__(outlines)
        self.camera = camera
        rays = camera.rays(self.pixels) @ camera.R.T if len(self.pixels) else np.zeros((0, 3))
        self.rays = rays

    def find_extreme_angles(self, forward: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Return `extremes` of the angles, rad, of directions whose parts (..., N) are given."""
        if forward.min(initial=1.0) > 0:  # the tangent rises with the angle and is quicker
            return np.arctan(self.extremes(across / forward))
        return self.extremes(np.arctan2(across, forward))

    def extreme_points(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return `extremes` and the pixels (F, 2, 2) of their corners."""
        found = self.extremes(values)
        pixels = np.full((self.n_frames, 2, 2), np.nan)
        lengths = np.diff([*self.starts, len(values)])
        for side in range(2):
            wanted = np.repeat(found[self.frames, side], lengths)
            at = np.nonzero(values == wanted)[0]
            rows = np.repeat(self.frames, lengths)[at]
            pixels[rows, side] = self.pixels[at]
        return found, pixels
