"""Image features that poses are compared with (Rymut 2016, 2.1 and 4.5), on an OpenCL device."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from cl import Array, Device, InputError, Launch
from cl.workgroups import row_group
from psfs.cameras.camera import CameraRig
from psfs.cameras.names import listed
from psfs.common.ranges import check_range
from psfs.config import SilhouetteConfig
from psfs.sequence import frame_input
from psfs.silhouettes.silhouette import Silhouette

if TYPE_CHECKING:
    from psfs.background.gaussian import Background
    from psfs.sequence import Frame

#: Where edges come from: the pictures' gradient, OpenCV's Canny, or the silhouette's outline
#: where there are no pictures.
EDGE_KINDS = ("sobel", "canny", "outline")
#: How the distance to the nearest edge becomes proximity, Rymut 2016 eq. (4.26)-(4.28).
PROXIMITIES = ("impulse", "proportional", "exponential")

#: A cell of so many pixels square counts for the region if this many of them are silhouette.
CELL, FILLED = 8, 16
#: The width of pictures that the pixels of a FeatureConfig are stated for.
STATED_WIDTH = 640
_GROUP = 128
#: Pixels of a row that one work-item of the costly kernels makes.
_STRIP = 8


@dataclass(frozen=True)
class FeatureConfig:
    """Parameters of the image features; lengths in pixels of pictures 640 wide.

    edges: one of EDGE_KINDS. threshold: least magnitude of Sobel's gradient of the grey picture
    (a step of h grey levels has 4 h, blurred about 3 h). canny_low, canny_high: Canny's two. The
    edges within `dilation` of the silhouette count. margin: of the region around the silhouette.

    proximity: one of PROXIMITIES, of the distance d to the nearest edge: 1 up to `nearest`, 0 from
    `farthest` on, between them 1 - span (d - nearest) / (farthest - nearest) (proportional) or
    1 - span + span exp(-decay (d - nearest)) (exponential); impulse: 1 on the edge, else 0.
    Rymut's eq. (4.28) has d_max for d_min in its first case, and a growing exponential.
    """

    edges: str = "sobel"
    threshold: float = 60.0
    canny_low: float = 40.0
    canny_high: float = 100.0
    dilation: float = 3.0
    margin: float = 10.0
    proximity: str = "exponential"
    nearest: float = 0.0
    farthest: float = 20.0
    span: float = 1.0
    decay: float = 0.25

    def __post_init__(self) -> None:
        for name, known in (("edges", EDGE_KINDS), ("proximity", PROXIMITIES)):
            if getattr(self, name) not in known:
                raise InputError(f"{name} is {getattr(self, name)!r}; expected {listed(known)}")
        check_range("the edge threshold", self.threshold, 0, 1500)
        if not 0 < self.canny_low <= self.canny_high:
            raise InputError(
                f"Canny's thresholds are {self.canny_low} and {self.canny_high}; "
                "expected 0 < low <= high"
            )
        check_range("dilation", self.dilation, 0, 100, ends=True)
        check_range("margin", self.margin, 0, ends=True)
        if not (0 <= self.nearest < self.farthest <= 1000 and 0 < self.span <= 1 < 1 + self.decay):
            raise InputError(
                f"proximity from {self.nearest} to {self.farthest} px, span {self.span}, decay "
                f"{self.decay}; expected 0 <= nearest < farthest <= 1000, span in (0, 1], decay > 0"
            )

    def pixels(self, length: float, rig: CameraRig) -> int:
        """A length stated for pictures 640 wide in whole pixels of the rig's."""
        return round(length * rig.width / STATED_WIDTH)

    @property
    def threshold2(self) -> int:
        """Least squared magnitude in the kernel's whole numbers, 16 times Sobel's."""
        return math.ceil((16 * self.threshold) ** 2)

    def proximity_table(self, rig: CameraRig) -> np.ndarray:
        """(reach^2 + 2,) uint8: 255 proximity by squared distance, px^2; the last entry is 0."""
        unit = rig.width / STATED_WIDTH
        reach = 0 if self.proximity == "impulse" else math.ceil(self.farthest * unit)
        distance = np.sqrt(np.arange(reach**2 + 2)) / unit
        beyond = distance - self.nearest
        if self.proximity == "impulse":
            values = np.where(distance == 0, 1.0, 0.0)
        elif self.proximity == "proportional":
            values = 1 - self.span * beyond / (self.farthest - self.nearest)
        else:
            values = 1 - self.span + self.span * np.exp(-self.decay * np.maximum(beyond, 0))
        if self.proximity != "impulse":
            values = np.where(beyond <= 0, 1.0, np.where(distance >= self.farthest, 0.0, values))
        values[-1] = 0.0
        return np.rint(255 * values).astype(np.uint8)


class Features:
    """`features(frame)`: the silhouettes and edges of a frame's pictures, on the device.

    maps: (V, H, W, 2) uint8, silhouette 0 or 255 and edge proximity 0..255, both 0 outside the
    region. roi: (V, 4) int32 x0, y0, x1, y1, the ends excluded, all 0 for a view without
    silhouette. The silhouette is where foreground is likelier than background; `background` None
    takes the frames' masks. A call overwrites both and only enqueues work. Twin:
    reference/features.py.
    """

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        background: Background | None,
        config: FeatureConfig | None = None,
    ) -> None:
        self.device, self.rig, self.config = device, rig, config or FeatureConfig()
        self._background = background
        # The foreground's colours are learnt from voxels, of which there are none here.
        self._silhouette = Silhouette(device, rig, background, SilhouetteConfig(learn=False))
        shape = (len(rig), rig.height, rig.width)
        self.maps = device.zeros((*shape, 2), np.uint8, "the feature maps")
        self.roi = device.zeros((len(rig), 4), np.int32, "the regions of interest")
        self._edges = device.empty(shape, np.uint8, "the edges")
        self._pictures: Array | None = None  # what edges are made of beside the silhouette's input
        sizes = device.to_device(np.array([c.size for c in rig], np.int32), "picture sizes")
        self._where = (self._silhouette.evidence, sizes, self.roi)
        kernel = self._kernel("region")
        region = device.launch(kernel, (len(rig) * _GROUP,), (_GROUP,), *self._where)
        self._launches = [region, *self._edge_launches(), *self._distance_launches()]

    def __call__(self, frame: Frame) -> Array:
        """Enqueue the features of `frame`, return `maps`. Raises InputError without pictures."""
        self._silhouette(frame_input(frame, self._background))
        if self._pictures is not None:
            images = edge_pictures(frame)
            canny = self.config.edges == "canny"
            self._pictures.set(canny_edges(images, self.rig, self.config) if canny else images)
        self.maps.fill(0)
        for launch in self._launches:
            launch()
        return self.maps

    def _edge_launches(self) -> list[Launch]:
        device, shape = self.device, self._edges.shape
        if self.config.edges == "outline":
            return [self._launch("outline_edges", 0, *self._where, self._edges)]
        if self.config.edges == "canny":
            self._pictures = device.empty(shape, np.uint8, "the edges")
            arrays = (self._pictures, *self._where, self._edges)
            return [self._launch("masked_edges", 0, *arrays)]
        images = self._silhouette.input
        if self._background is None:
            images = self._pictures = device.empty((*shape, 3), np.uint8, "the pictures")
        planes = [
            device.empty((*shape[:2], self.rig.width + _STRIP), np.int16, "the gradients")
            for _ in range(2)
        ]
        above_below = 4
        return [
            self._launch("gradient_rows", above_below, images, *self._where[1:], *planes),
            self._launch("gradient_edges", 0, *planes, *self._where, self._edges),
        ]

    def _distance_launches(self) -> list[Launch]:
        evidence = self._where[0]
        table = self.config.proximity_table(self.rig)
        return distance_launches(self.device, evidence, self._edges, self.roi, table, self.maps)

    def _launch(self, name: str, more_rows: int, *arrays: Array) -> Launch:
        strips = name.startswith("gradient")
        width = -(-self.rig.width // _STRIP) if strips else self.rig.width
        size = (width, self.rig.height + more_rows, len(self.rig))
        return self.device.launch(self._kernel(name), size, row_group(self.device, width), *arrays)

    def _kernel(self, name: str) -> Any:
        config, rig = self.config, self.rig
        return self.device.kernel(
            "image/features",
            name,
            **{"WIDTH": rig.width, "HEIGHT": rig.height, "GROUP": _GROUP},
            **{"PITCH": rig.width + _STRIP, "THRESHOLD2": config.threshold2},
            **{"CELL": CELL, "FILLED": FILLED, "MARGIN": config.pixels(config.margin, rig)},
            **{"DILATION": config.pixels(config.dilation, rig)},
        )


def distance_launches(
    device: Device, evidence: Array, edges: Array, roi: Array, table: np.ndarray, maps: Array
) -> list[Launch]:
    """The launches that fill `maps` (V, H, W, 2) uint8 within the regions `roi` (V, 4).

    Channel 0: 255 where `evidence` (V, H, W) int8 is positive. Channel 1: the entry of `table`
    (reach^2 + 2,) uint8 at the exact squared distance, px^2, to the nearest of the `edges`
    (V, H, W) uint8 in the region, the last entry beyond reach.
    """
    views, height, width = edges.shape
    reach = math.isqrt(len(table) - 2)
    pitch, strips = width + 2 * reach + _STRIP, -(-width // _STRIP)
    defines = {"WIDTH": width, "HEIGHT": height, "REACH": reach}
    gaps = device.empty((views, height, pitch), np.uint16, "the edge distances")
    proximity = device.to_device(table, "the proximity table")
    return [
        device.launch(
            device.kernel("image/distance", "column_gaps", **defines),
            (pitch, views),
            (64, 1),
            *(edges, roi, gaps),
        ),
        device.launch(
            device.kernel("image/distance", "nearest_edge", **defines),
            (strips, height, views),
            row_group(device, strips),
            *(evidence, gaps, roi, proximity, maps),
        ),
    ]


def edge_pictures(frame: Frame) -> np.ndarray:
    """The frame's pictures; InputError if it has none to find edges in."""
    if frame.images is None:
        raise InputError(
            f"frame {frame.index} has no pictures to find edges in; expected images, "
            "or outline as kind of edges"
        )
    return frame.images


def canny_edges(images: np.ndarray, rig: CameraRig, config: FeatureConfig) -> np.ndarray:
    """Canny's edges (V, H, W) uint8 0 or 255 of pictures (V, H, W, 3) uint8, by OpenCV.

    On the host: following weak edges from pixel to pixel is no work for a device, and a picture
    640 x 480 takes OpenCV about a millisecond.
    """
    edges = np.zeros(images.shape[:3], np.uint8)
    for view, camera in enumerate(rig):
        width, height = camera.size
        picture = cv2.cvtColor(images[view, :height, :width], cv2.COLOR_BGR2GRAY)
        smooth = cv2.GaussianBlur(picture, (3, 3), 0)
        edges[view, :height, :width] = cv2.Canny(
            smooth, config.canny_low, config.canny_high, L2gradient=True
        )
    return edges
