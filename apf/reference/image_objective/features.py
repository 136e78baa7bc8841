"""Image features in NumPy and OpenCV. Twin of features.cl and distance.cl."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
import scipy

from apf.image_objective.config import FeatureConfig
from apf.image_objective.features import CELL, CELL_PIXELS, canny_edges, edge_pictures
from apf.reference.likelihood.contour import DERIVATIVE, SMOOTHING
from cl import NumpyDevice
from psfs.cameras.camera import CameraRig
from psfs.reference.reprojection import boundary, proximity
from psfs.reference.silhouette import mask_evidence, silhouette_evidence
from psfs.sequence import frame_input
from psfs.silhouettes.config import SilhouetteConfig

if TYPE_CHECKING:
    from psfs.background.gaussian import Background
    from psfs.sequence import Frame


def region(silhouette: np.ndarray, margin: int, blobs: int = 0) -> np.ndarray:
    """Return (4,) x0, y0, x1, y1 of a silhouette (h, w) bool, the ends excluded, 0 where there is
    none.

    Rymut 2016, 4.5: bounding box, `margin` px larger within the picture. Only cells of `CELL` px
    square with at least `CELL_PIXELS` of silhouette count, so that no speck does; of these, where
    `blobs` is positive, those of so many largest connected parts (5.5).
    """
    height, width = silhouette.shape
    rows, columns = np.nonzero(silhouette)
    counts = np.zeros((-(-height // CELL), -(-width // CELL)), int)
    np.add.at(counts, (rows // CELL, columns // CELL), 1)
    filled = counts >= CELL_PIXELS
    if blobs:
        parts, n_parts = scipy.ndimage.label(filled, np.ones((3, 3)))
        pixels = scipy.ndimage.sum_labels(counts, parts, range(1, n_parts + 1))
        largest = 1 + np.argsort(-np.asarray(pixels), kind="stable")[:blobs]
        filled = np.isin(parts, largest)
    y, x = np.nonzero(filled)
    if not y.size:
        return np.zeros(4, np.int32)
    low = np.array([x.min(), y.min()]) * CELL
    high = np.minimum((np.array([x.max(), y.max()]) + 1) * CELL, (width, height))
    return np.concatenate(
        [np.maximum(low - margin, 0), np.minimum(high + margin, (width, height))]
    ).astype(np.int32)


def sobel_edges(image: np.ndarray, config: FeatureConfig) -> np.ndarray:
    """Return (h, w) bool: where the gradient's magnitude (Rymut 2016 eq. 2.8) of a picture
    (h, w, 3) uint8, after a Gaussian of 3x3 pixels, reaches the threshold.

    The grey picture is in whole numbers.
    """
    blue, green, red = np.moveaxis(image.astype(int), -1, 0)
    grey = ((29 * blue + 150 * green + 77 * red + 128) >> 8).astype(np.float64)
    border = cv2.BORDER_REPLICATE
    gx = cv2.sepFilter2D(grey, cv2.CV_64F, DERIVATIVE / 4, SMOOTHING / 4, borderType=border)
    gy = cv2.sepFilter2D(grey, cv2.CV_64F, SMOOTHING / 4, DERIVATIVE / 4, borderType=border)
    return gx**2 + gy**2 >= config.squared_threshold / 16**2


class NumpyFeatures:
    """Same signature and results as `Features`; `maps` and `roi` are NumPy arrays."""

    def __init__(
        self,
        device: NumpyDevice,
        rig: CameraRig,
        background: Background | None,
        config: FeatureConfig | None = None,
        silhouette: SilhouetteConfig | None = None,
    ) -> None:
        self.device, self.rig, self.config = device, rig, config or FeatureConfig()
        self._background = background
        self._silhouette = (silhouette or SilhouetteConfig()).without_memory()
        self.maps = np.zeros((len(rig), rig.height, rig.width, 2), np.uint8)
        self.roi = np.zeros((len(rig), 4), np.int32)

    def __call__(self, frame: Frame) -> np.ndarray:
        silhouettes = self._silhouettes(frame)
        edges = self._edges(frame, silhouettes)
        near, table = self.config.proximity, self.config.proximity.table(self.rig)
        margin = self.config.pixels(self.config.margin, self.rig)
        self.maps = np.zeros_like(self.maps)
        for view, (width, height) in enumerate(camera.size for camera in self.rig):
            silhouette = silhouettes[view, :height, :width]
            self.roi[view] = region(silhouette, margin, self.config.blobs)
            x0, y0, x1, y1 = self.roi[view]
            inside = (view, slice(y0, y1), slice(x0, x1))
            if x1 > x0:
                channels = (255 * silhouettes[inside], proximity(edges[inside], table, near.metric))
                self.maps[inside] = np.stack(channels, -1)
        return self.maps

    def _silhouettes(self, frame: Frame) -> np.ndarray:
        """Return the silhouettes (V, H, W) bool."""
        pictures, config = frame_input(frame, self._background), self._silhouette
        if self._background is None:
            return mask_evidence(pictures, self.rig, config) > 0
        return silhouette_evidence(pictures, self.rig, self._background, config) > 0

    def _edges(self, frame: Frame, silhouettes: np.ndarray) -> np.ndarray:
        """Return the edges (V, H, W) bool."""
        if self.config.edges == "outline":
            pairs = zip(silhouettes, self.rig, strict=True)
            return np.stack([boundary(silhouette, camera.size) for silhouette, camera in pairs])
        images, edges = edge_pictures(frame), np.zeros(silhouettes.shape, bool)
        if self.config.edges == "canny":
            edges = canny_edges(images, self.rig) > 0
        else:
            for view, (width, height) in enumerate(camera.size for camera in self.rig):
                picture = images[view, :height, :width]
                edges[view, :height, :width] = sobel_edges(picture, self.config)
        radius = self.config.pixels(self.config.dilation, self.rig)
        square = np.ones((1, 2 * radius + 1, 2 * radius + 1), bool)
        return edges & scipy.ndimage.binary_dilation(silhouettes, square)
