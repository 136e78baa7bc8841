"""Contours of the pictures. Twin of apf/likelihood/contour.py, contour.cl and the term in
likelihood.cl."""

from __future__ import annotations

import numpy as np
import scipy

from apf.body.cones import project_outlines
from apf.body.model import BodyModel
from apf.likelihood.contour import (
    DIAGONAL_REACH,
    FULL_CONTRAST,
    HIDDEN,
    MARGIN,
    N_NORMALS,
    OUTER_MARGIN,
    REACH,
)
from apf.likelihood.part_colour import list_scored_parts
from apf.likelihood.term import SharedTwin, TermTwin
from apf.likelihood.terms import ContourConfig
from apf.reference.likelihood.part_colour import hidden_by_trunk, lookup_pixels
from psfs.cameras.camera import Camera
from psfs.voxels.host_voxels import HostVoxels

#: Gaussian 3x3 and then Sobel along one axis: a derivative there, smoothing across.
DERIVATIVE, SMOOTHING = np.array([-1, -2, 0, 2, 1]), np.array([1, 4, 6, 4, 1])
#: Blue, green and red in grey, in 256ths (ITU-R BT.601).
_GREY = np.array([29, 150, 77])
#: Slope from which a line counts as upright or level.
_STEEP = 2.41421356


def compute_gradients(pictures: np.ndarray, maps: np.ndarray) -> np.ndarray:
    """Return the derivatives (V, 2, H, W) int16 along x and y, by the Sobel operator of 5 x 5
    pixels, of pictures (V, H, W, 3) uint8 BGR where maps (V, H, W, 2) are not 0; 0 within MARGIN
    pixels of the border."""
    grey = pictures.astype(np.int32) @ _GREY >> 8
    along = []
    for axis in (2, 1):
        other = 3 - axis
        smooth = scipy.ndimage.correlate1d(grey, SMOOTHING, other, mode="nearest")
        along.append(scipy.ndimage.correlate1d(smooth, DERIVATIVE, axis, mode="nearest"))
    return np.where(_visible_pixels(maps, MARGIN), np.stack(along, 1), 0).astype(np.int16)


def compute_contours(gradients: np.ndarray, maps: np.ndarray, contrast: int) -> np.ndarray:
    """Return contours (V, 4, H, W) uint8: the largest derivative along each of the normals (1, 0),
    (1, 1), (0, 1) and (-1, 1) within REACH along it, 255 at `contrast` and beyond, HIDDEN
    where furniture is before the body; 0 within OUTER_MARGIN pixels of the border."""
    views, _, height, width = gradients.shape
    x, y = np.moveaxis(gradients.astype(np.int32), 1, 0)
    slopes = np.abs(x), np.abs(x + y) * 181 >> 8, np.abs(y), np.abs(y - x) * 181 >> 8
    contours = np.zeros((views, N_NORMALS, height, width), np.int32)
    steps = ((1, 0), (1, 1), (0, 1), (-1, 1))
    for normal, (slope, (dx, dy)) in enumerate(zip(slopes, steps, strict=True)):
        reach = DIAGONAL_REACH if dx and dy else REACH
        for step in range(-reach, reach + 1):
            columns = np.clip(np.arange(width) + step * dx, 0, width - 1)
            rows = np.clip(np.arange(height) + step * dy, 0, height - 1)
            moved = slope[:, rows[:, None], columns]
            contours[:, normal] = np.maximum(contours[:, normal], moved)
    scale = (255 << 16) // contrast + 1
    values = np.minimum(contours, contrast) * scale >> 16
    silhouettes = maps[:, None, ..., 0]
    hidden = (silhouettes == 1) | (silhouettes == 254)
    values = np.where(hidden, HIDDEN, values)
    return np.where(_visible_pixels(maps, OUTER_MARGIN), values, 0).astype(np.uint8)


def _visible_pixels(maps: np.ndarray, margin: int) -> np.ndarray:
    """Return (V, 1, H, W) where maps (V, H, W, 2) are not 0, outside `margin` px of the border."""
    visible = np.zeros((len(maps), 1, *maps.shape[1:3]), bool)
    inner = slice(margin, -margin)
    visible[:, 0, inner, inner] = maps[:, inner, inner].max(-1) > 0
    return visible


def contour_means(
    camera: Camera,
    body: BodyModel,
    cones: np.ndarray,
    contours: np.ndarray,
    row_parts: np.ndarray,
    rows: np.ndarray,
) -> np.ndarray:
    """Return (N,) the mean, 0 to 1, of the contours (4, H, W) that a camera sees along the outlines
    of the rows (R, 4) of cones (N, C, 16); 0 where it sees none of them.

    Rows whose part (R,) is -1 and samples that the trunk hides are ignored.
    """
    rows = rows[row_parts >= 0]
    corners = project_outlines(camera, cones)
    quads = corners[:, rows[:, 0].astype(int)]
    lines = quads[:, :, [3, 2]] - quads[:, :, :2]  # left and right, (N, rows, 2, 2)
    pixels = quads[:, :, :2] + rows[:, 1, None, None] * lines
    y, x, seen = lookup_pixels(camera, pixels)
    seen &= ~hidden_by_trunk(camera, body, cones, corners, rows, pixels)
    sums = np.where(seen, contours[_normals(lines), y, x].astype(float), 0).sum((1, 2))
    return sums / (255 * np.maximum(seen.sum((1, 2)), 1))


def _normals(lines: np.ndarray) -> np.ndarray:
    """Return the indices (...) of the normals of lines in directions (..., 2)."""
    x, y = np.moveaxis(np.nan_to_num(lines), -1, 0)
    diagonal = np.where(x * y < 0, 1, 3)
    level = np.where(np.abs(x) > _STEEP * np.abs(y), 2, diagonal)
    return np.where(np.abs(y) > _STEEP * np.abs(x), 0, level)


class NumpyContours(TermTwin):
    """The term in NumPy; `contours` (V, 4, H, W) of the latest frame, None without pictures."""

    def __init__(self, shared: SharedTwin, settings: ContourConfig) -> None:
        self._scene, self._settings, self._rows = shared.scene, settings, shared.rows
        self._row_parts = list_scored_parts(shared.scene.body, shared.rows)
        self.contours: np.ndarray | None = None

    def observe(self, voxels: HostVoxels, maps: np.ndarray) -> None:
        self.contours = None
        if voxels.pictures is not None:
            gradients = compute_gradients(voxels.pictures, maps)
            self.contours = compute_contours(gradients, maps, FULL_CONTRAST)

    def view_errors(self, view: int, cones: np.ndarray) -> np.ndarray | None:
        if self.contours is None:
            return None
        camera, body, view_maps = self._scene.rig[view], self._scene.body, self.contours[view]
        means = contour_means(camera, body, cones, view_maps, self._row_parts, self._rows)
        return self._settings.weight * (1 - means)
