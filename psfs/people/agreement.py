"""Agreement of the cameras on the colours of voxels, by which ghosts differ from arms.

All cameras that see a body's surface see its colour there. Through a voxel that people make in a
hull between them each camera sees another place behind it.
"""

from __future__ import annotations

from itertools import combinations

import cv2
import numpy as np
import scipy

from psfs.cameras.camera import CameraRig

#: Added to a pixel's values of 0 to 255 before the logarithm: noise of dark pixels counts little.
_DARK = 8.0
#: Estimates of each camera's gains, which need not be those of the others.
_ROUNDS = 3
#: Greatest distance of two cameras' colours that counts: beyond it they show different things,
#: however far (Euclidean distance of the natural logarithms of three channels).
_MOST = 0.4
#: Depth, in voxels, up to which a camera sees a voxel behind the nearest one.
_TOLERANCE = 2.0
#: Edge of the blocks of voxels whose disagreement is kept, m.
_BLOCK = 0.04
#: Distance over which disagreement is averaged, and up to which it holds, m.
_REACH = 0.08


class Disagreement:
    """Disagreement, values (N,), of cameras on the colours of blocks of voxels, (N, 3) int, in
    edges of a block from the origin. It is kept small: a take has many frames."""

    def __init__(self, blocks: np.ndarray, values: np.ndarray) -> None:
        self._blocks, self._values = blocks.astype(np.int16), values.astype(np.float16)

    def find(self, points: np.ndarray) -> np.ndarray:
        """Return the disagreement (N,) at points (N, 3) m, NaN where it is not known."""
        places = scipy.spatial.cKDTree(_find_middles(self._blocks))
        _, nearest = places.query(points, distance_upper_bound=_REACH)
        return np.append(self._values, np.float16(np.nan))[nearest]


def measure_disagreement(
    rig: CameraRig, images: np.ndarray, depths: np.ndarray, points: np.ndarray, voxel: float
) -> Disagreement:
    """Measure how far the logarithms of the colours at a person's surface voxels, points (N, 3) m,
    differ between the cameras that see them, after their medians over the voxels are made equal.

    images: (V, H, W, 3) uint8. depths: (V, H, W) m of all voxels. voxel: their edge, m.
    """
    colours = np.full((len(rig), len(points), 3), np.nan)
    for camera, image, depth, seen in zip(rig, images, depths, colours, strict=True):
        inside, row, column, away = camera.look_up(points)
        shown = away - depth[row, column] < _TOLERANCE * voxel
        pixels = cv2.blur(image, (3, 3))[row, column].astype(float)
        seen[inside] = np.where(shown[:, None], np.log(pixels + _DARK), np.nan)
    several = np.isfinite(colours[..., 0]).sum(0) > 1
    colours, points = colours[:, several], points[several]
    for _ in range(_ROUNDS):
        mean = np.nanmean(colours, axis=0)
        for seen in colours:
            if np.isfinite(seen).any():
                seen -= np.nanmedian(seen - mean, axis=0)
    apart = np.stack([np.linalg.norm(a - b, axis=1) for a, b in combinations(colours, 2)])
    apart = np.nanmean(np.minimum(apart, _MOST), axis=0)
    blocks, of, counts = np.unique(
        np.floor(points / _BLOCK), axis=0, return_inverse=True, return_counts=True
    )
    places = _find_middles(blocks)
    sums = np.bincount(of.ravel(), apart, len(blocks))
    around = scipy.spatial.distance.cdist(places, places) < _REACH
    return Disagreement(blocks, around @ sums / np.maximum(1, around @ counts))


def _find_middles(blocks: np.ndarray) -> np.ndarray:
    """Return the centres (N, 3) m of blocks (N, 3)."""
    return _BLOCK * (blocks + 0.5)
