"""Image features that poses are compared with (Rymut 2016, 2.1 and 4.5), on an OpenCL device."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cv2
import numpy as np

from apf.image_objective.config import FeatureConfig
from cl import Array, Device, InputError, Launch
from cl.launch import Kernel
from cl.signature import Argument
from cl.workgroups import GROUP, PIXELS, row_group, size_defines
from psfs.cameras.camera import CameraRig
from psfs.common.edge_distance import count_tiles, distance_defines
from psfs.sequence import frame_input
from psfs.silhouettes.config import SilhouetteConfig
from psfs.silhouettes.silhouette import Silhouette

if TYPE_CHECKING:
    from psfs.background.gaussian import Background
    from psfs.sequence import Frame

#: Side, px, of the cells that the region of interest consists of, small against a limb, and the
#: least silhouette pixels in one of them: specks of noise have fewer.
CELL, CELL_PIXELS = 8, 16
#: Canny's thresholds of Sobel's magnitude, grey levels, in the ratio of 2 to 3 that Canny 1986
#: recommends.
_CANNY = (40.0, 100.0)


class Features:
    """Extractor of silhouettes and edges from a frame's pictures on the device: `features(frame)`.

    maps: (V, H, W, 2) uint8, silhouette 0 or 255 and edge proximity 0..255, both 0 outside the
    region of interest. roi: (V, 4) int32 x0, y0, x1, y1 of that region, the ends excluded; all 0
    for a view without silhouette. A pixel is in the silhouette if foreground is likelier than
    background; if `background` is None, the frames' masks are used. A call overwrites `maps` and
    `roi` and only enqueues work. Twin: reference/image_objective/features.py.
    """

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        background: Background | None,
        config: FeatureConfig | None = None,
        silhouette: SilhouetteConfig | None = None,
    ) -> None:
        self.device, self.rig, self.config = device, rig, config or FeatureConfig()
        self._background = background
        # The foreground's colours are estimated from voxels, and there are no voxels here.
        forgetful = (silhouette or SilhouetteConfig()).without_memory()
        self._silhouette = Silhouette(device, rig, background, forgetful)
        shape = (len(rig), rig.height, rig.width)
        self.maps = device.zeros((*shape, 2), np.uint8, "the feature maps")
        self.roi = device.zeros((len(rig), 4), np.int32, "the regions of interest")
        self._edges = device.empty(shape, np.uint8, "the edges")
        self._pictures: Array | None = None  # what edges are made of beside the silhouette's input
        sizes = device.to_device(np.array([c.size for c in rig], np.int32), "picture sizes")
        self._where: dict[str, Argument] = {"picture": rig.picture, "sizes": sizes}
        self._where["regions"] = self.roi
        self._evidence = self._silhouette.evidence
        self._launches = [self._region_launch(), *self._edge_launches(), self._distance_launch()]

    def __call__(self, frame: Frame) -> Array:
        """Enqueue the features of `frame` and return `maps`. Raises InputError without pictures."""
        self._silhouette(frame_input(frame, self._background))
        if self._pictures is not None:
            images = edge_pictures(frame)
            canny = self.config.edges == "canny"
            self._pictures.set(canny_edges(images, self.rig) if canny else images)
        self.maps.fill(0)
        for launch in self._launches:
            launch()
        return self.maps

    def _region_launch(self) -> Launch:
        """Return the launch that finds the regions of interest."""
        device, views, arguments = self.device, len(self.rig), {"evidence": self._evidence}
        name = "blob_region" if self.config.blobs else "region"
        if self.config.blobs:
            cells = [-(-size // CELL) for size in (self.rig.height, self.rig.width)]
            arguments["blobs"] = device.empty((views, *cells), np.int32, "the silhouette's blobs")
            arguments["pixels"] = device.empty((views, 2, *cells), np.int32, "the blobs' pixels")
        size, margin = (views * GROUP,), self.config.pixels(self.config.margin, self.rig)
        where = self._where | {"margin": margin}
        return device.launch(self._kernel(name), size, (GROUP,), **where, **arguments)

    def _edge_launches(self) -> list[Launch]:
        """Return the launches that find the edges."""
        device, shape = self.device, self._edges.shape
        arguments = {"evidence": self._evidence, "edges": self._edges}
        if self.config.edges == "outline":
            return [self._launch("outline_edges", 0, **arguments)]
        near = {"dilation": self.config.pixels(self.config.dilation, self.rig)}
        if self.config.edges == "canny":
            self._pictures = device.empty(shape, np.uint8, "the edges")
            return [self._launch("masked_edges", 0, candidates=self._pictures, **near, **arguments)]
        images = self._silhouette.input
        if self._background is None:
            images = self._pictures = device.empty((*shape, 3), np.uint8, "the pictures")
        planes = {
            name: device.empty((*shape[:2], self.rig.width + PIXELS), np.int16, "the gradients")
            for name in ("derivatives", "smooth")
        }
        above_below, threshold2 = 4, min(self.config.squared_threshold, 2**31 - 1)
        return [
            self._launch("gradient_rows", above_below, images=images, **planes),
            self._launch("gradient_edges", 0, **planes, **near, **arguments, threshold2=threshold2),
        ]

    def _distance_launch(self) -> Launch:
        """Return the launch that fills `maps`."""
        proximity = self.config.proximity
        arguments = (self._evidence, self._edges, self.roi, proximity.table(self.rig), self.maps)
        return distance_launch(self.device, *arguments, metric=proximity.metric)

    def _launch(self, name: str, more_rows: int, /, **arguments: Argument) -> Launch:
        """Return the launch of a kernel over all pixels, and `more_rows` beside them."""
        strips = name.startswith("gradient")
        width = -(-self.rig.width // PIXELS) if strips else self.rig.width
        size = (width, self.rig.height + more_rows, len(self.rig))
        group = row_group(self.device)
        return self.device.launch(self._kernel(name), size, group, **self._where, **arguments)

    def _kernel(self, name: str) -> Kernel:
        config = self.config
        return self.device.kernel(
            "image/features",
            name,
            **size_defines(self.device, self.rig.picture),
            GROUP=GROUP,
            STRIP=PIXELS,
            CELL=CELL,
            BLOBS=config.blobs,
            FILLED=CELL_PIXELS,
        )


def distance_launch(
    device: Device,
    evidence: Array,
    edges: Array,
    roi: Array,
    table: np.ndarray,
    maps: Array,
    *,
    metric: str = "euclidean",
) -> Launch:
    """Return the launch that fills `maps` (V, H, W, 2) uint8 within the regions `roi` (V, 4).

    Channel 0: 255 where `evidence` (V, H, W) int8 is positive. Channel 1: the entry of `table`
    (reach^2 + 2,) uint8 at the exact squared distance, px^2, to the nearest of the `edges`
    (V, H, W) uint8 in the region, the last entry beyond reach. metric: as of `ProximityConfig`.
    """
    views, height, width = edges.shape
    # No distance is longer than the picture's diagonal.
    reach = min(math.isqrt(len(table) - 2), math.isqrt(width**2 + height**2) + 1)
    table = np.append(table[: reach**2 + 1], table[-1:])
    defines = distance_defines(device, reach)
    defines["CHESSBOARD"] = int(metric == "chessboard")
    group = defines["GROUP"]
    return device.launch(
        device.kernel("image/distance", "edge_proximity", **defines),
        (count_tiles(defines, (width, height)) * group, views),
        (group, 1),
        picture=(width, height),
        reach=reach,
        evidence=evidence,
        edges=edges,
        regions=roi,
        proximity=device.to_device(table, "the proximity table"),
        maps=maps,
    )


def edge_pictures(frame: Frame) -> np.ndarray:
    """Return the frame's pictures. Raises InputError if it has none to find edges in."""
    if frame.images is None:
        raise InputError(
            f"frame {frame.index} has no pictures to find edges in; expected images, "
            "or outline as kind of edges"
        )
    return frame.images


def canny_edges(images: np.ndarray, rig: CameraRig) -> np.ndarray:
    """Find Canny's edges (V, H, W) uint8 0 or 255 in pictures (V, H, W, 3) uint8, by OpenCV.

    This runs on the host: following weak edges from pixel to pixel does not suit a GPU, and OpenCV
    takes about 1 ms for a picture of 640 x 480.
    """
    edges = np.zeros(images.shape[:3], np.uint8)
    for view, camera in enumerate(rig):
        width, height = camera.size
        picture = cv2.cvtColor(images[view, :height, :width], cv2.COLOR_BGR2GRAY)
        smooth = cv2.GaussianBlur(picture, (3, 3), 0)
        edges[view, :height, :width] = cv2.Canny(smooth, *_CANNY, L2gradient=True)
    return edges
