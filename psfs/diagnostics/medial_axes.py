"""Medial axes of the limbs in one camera's silhouettes.

Where two stretches of a contour face each other, their middles are the limb's medial axis. It is
the projection of the axis of a limb, whose cross-sections are nearly symmetric, and does not move
if the silhouette is too wide or too narrow.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
import scipy

from psfs.cameras.camera import Camera
from psfs.diagnostics.frontier import SilhouetteContours

#: Standard deviation of the contours' smoothing, px; least cosine between the edges of a limb.
_SMOOTH, OPPOSITE = 2.0, 0.9
#: Points of a contour on either side by which its direction is measured.
_SIDE = 3
#: Farthest way of a facing point aside, px, and its least distance: nearer ones are neighbours.
_ASIDE, _NEXT = 0.9, 2.0
#: Pixels of a cell of the map of nearest points, and its greatest distance in cells.
_CELL, _FARTHEST = 4, 3
#: Cells around the picture, for places without the lens's distortion.
_MARGIN = 20


@dataclass(frozen=True, eq=False)
class MedialAxes:
    """N points of the medial axes in one camera's pictures of F frames.

    frames: (N,) in ascending order. places: (N, 2) px from the principal point of a
    picture without distortion. across: (N, 2) unit vectors across the limb. widths: (N,) px.
    nearest: (F, h, w) index of a cell's nearest point in each frame, -1 without one nearby.
    """

    frames: np.ndarray
    places: np.ndarray
    across: np.ndarray
    widths: np.ndarray
    nearest: np.ndarray

    @classmethod
    def create(cls, camera: Camera, contours: SilhouetteContours) -> MedialAxes:
        """Measure the medial axes of a camera's contours."""
        count = int(contours.frames.max(initial=-1)) + 1
        pixels = camera.K[0, 0] * camera.normalise(contours.points)
        begins = np.searchsorted(contours.frames, np.arange(count + 1))
        middles = [
            _find_middles(pixels[begin:end], contours.at_border[begin:end] > 0)
            for begin, end in pairwise(begins)
        ]
        frames = np.repeat(np.arange(count), [len(columns[2]) for columns in middles])
        none = np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
        places, across, widths = map(np.concatenate, zip(none, *middles, strict=True))
        shape = tuple(side // _CELL + 2 * _MARGIN for side in camera.size[::-1])
        nearest = _map_nearest(places, frames, count, shape)
        return cls(frames, places, across, widths, nearest)

    def find_nearest(self, frames: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Return the indices (...) of the points nearest to places (..., 2) in frames (...); -1
        without one nearby."""
        count, height, width = self.nearest.shape
        cells = _find_cells(places, (height, width))
        x, y = cells[..., 0], cells[..., 1]
        frames = np.broadcast_to(frames, x.shape)
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height) & (frames >= 0) & (frames < count)
        indices = np.full(x.shape, -1)
        indices[inside] = self.nearest[frames[inside], y[inside], x[inside]]
        return indices


def _find_middles(
    pixels: np.ndarray, at_border: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the middles (N, 2) between facing points of a closed contour, the unit vectors across
    (N, 2) and the widths (N,)."""
    if len(pixels) < 4 * _SIDE:
        return np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
    smooth = scipy.ndimage.gaussian_filter1d(pixels, _SMOOTH, axis=0, mode="wrap")
    along = np.roll(smooth, -_SIDE, 0) - np.roll(smooth, _SIDE, 0)
    along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-12
    after = np.roll(smooth, -1, 0)
    side = np.sign((smooth[:, 0] * after[:, 1] - after[:, 0] * smooth[:, 1]).sum())
    inward = side * np.stack([-along[:, 1], along[:, 0]], -1)
    first = np.arange(0, len(pixels), 2)
    start = smooth[first]
    depth = inward[first] @ smooth.T - (inward[first] * start).sum(1)[:, None]
    aside = along[first] @ smooth.T - (along[first] * start).sum(1)[:, None]
    depth[(np.abs(aside) > _ASIDE) | (depth < _NEXT)] = np.inf
    second = depth.argmin(axis=1)
    facing = np.isfinite(depth[np.arange(len(first)), second]) & ~at_border[first]
    first, second = first[facing & ~at_border[second]], second[facing & ~at_border[second]]
    cosines = (inward[first] * inward[second]).sum(1)
    opposite = cosines < -OPPOSITE
    first, second, cosines = first[opposite], second[opposite], cosines[opposite]
    widths = ((smooth[second] - smooth[first]) * inward[second]).sum(1) / cosines
    across = inward[first] - inward[second]
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    middles = smooth[first] + 0.5 * widths[:, None] * inward[first]
    return middles, across, widths


def _find_cells(places: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return the columns and rows (..., 2) of places (..., 2), the principal point in the middle;
    -1 far outside."""
    cells = places / _CELL + 0.5 * np.array(shape[::-1])
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(cells) < 1e4, cells, -1).astype(int)


def _map_nearest(
    places: np.ndarray, frames: np.ndarray, count: int, shape: tuple[int, ...]
) -> np.ndarray:
    nearest = np.full((count, *shape), -1, np.int32)
    cells = _find_cells(places, shape).clip(0, np.array(shape[::-1]) - 1)
    begins = np.searchsorted(frames, np.arange(count + 1))
    for frame, (begin, end) in enumerate(pairwise(begins)):
        if begin == end:
            continue
        x, y = cells[begin:end].T
        empty = np.ones(shape, np.uint8)
        empty[y, x] = 0
        away, labels = cv2.distanceTransformWithLabels(
            empty, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        of_label = np.zeros(labels.max() + 1, int)
        of_label[labels[y, x]] = np.arange(begin, end)
        nearest[frame] = np.where(away <= _FARTHEST, of_label[labels], -1)
    return nearest
