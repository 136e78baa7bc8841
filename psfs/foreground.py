"""What the reconstructed person teaches about the next frame's silhouettes, on the device.

Song et al. 2.2.1: the uniform foreground of eq. (2) is for the first frame only.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from cl import Array, Device, Launch
from psfs.camera import CameraRig
from psfs.config import SilhouetteConfig
from psfs.extent import axes_meet
from psfs.footprints import footprints
from psfs.launching import row_group

if TYPE_CHECKING:
    from psfs.reconstruct import Voxels

#: Colour bins per channel of the histogram.
BINS = 32
#: Edge of the cells, px, in which the person's place is marked; one pixel of each is sampled.
CELL = 4
#: Share of the histogram's weight that a frame leaves of the earlier ones.
KEEP = 0.9
#: Weight of the uniform foreground beside the histogram: colours never seen stay possible.
UNIFORM = 0.1
#: Samples that the histogram begins with, spread over all colours.
PRIOR = 200.0
#: Frames in which more than this share of the cells look like the person are not learnt from.
MOST = 0.4
#: Surface voxels below which nobody is there, and no shadow of his either.
MIN_SURFACE = 64
#: m above the floor; the person's place goes on from there straight down, in steps of `STRIDE`:
#: a leg once taken for a shadow would otherwise stay one.
HIPS, STRIDE = 0.6, 0.08
#: Cells that the person's place is wider than the voxels, for the way to the next frame.
MARGIN = 1.0
#: A frame so many after the one before is too late for what was learnt of the person's place.
MAX_GAP = 3


class Foreground:
    """Learns from the voxels of a frame what the silhouettes of the next one take for granted.

    colours: (BINS^3,) int8, the log of the person's colour density over the uniform one, counts
    of `config.ratio_steps`; a histogram that forgets. zone: (V, cells) uint8, 1 where the floor
    is seen and not the person's own place: a shadow may lie there. Both are filled in place by
    `learn`. Guards against learning one's own mistakes: only pixels that look
    like foreground by themselves and lie where voxels well above the floor reproject are counted,
    never a frame that looks like foreground all over, and colours never seen stay possible.
    """

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        pictures: Array,
        evidence: Array,
        colours: Array,
        zone: Array,
        config: SilhouetteConfig,
    ) -> None:
        self.colours, self.zone = colours, zone
        self._device, self._rig, self._config = device, rig, config
        self._pictures, self._evidence = pictures, evidence
        self._coarse = rig.scaled(1 / CELL)
        self._cameras = device.to_device(self._coarse.packed(), "the cameras")
        self._floor = device.to_device(floor_cells(rig, config.floor).astype(np.uint8), "the floor")
        self._extents = device.empty((len(rig), 2), np.float32, "the footprints")
        self._geometry = device.empty(4, np.float32, "the grid's position")
        self._body = device.zeros(zone.shape, np.uint8, "the person's place")
        self._counts = device.zeros(BINS**3 + 1, np.int32, "the colour histogram")
        self._memory = device.zeros(BINS**3 + 1, np.float32, "the colour histogram")
        self._voxels: Voxels | None = None
        self._place: tuple[float, ...] = ()
        self._launches: list[Launch] = []

    def learn(self, voxels: Voxels) -> None:
        """Enqueue learning from the voxels made of the pictures on the device."""
        if voxels is not self._voxels:
            self._attach(voxels)
        grid = voxels.grid
        place = (*grid.origin, grid.voxel_size)
        if place != self._place:
            self._place = place
            self._geometry.set(np.array(place, np.float32))
            self._extents.set(footprints(self._coarse, grid.voxel_size).astype(np.float32))
        self._counts.fill(0)
        for launch in self._launches:
            launch()

    def forget_place(self) -> None:
        """Nothing is known of where the person stands in the next frame; colours are kept."""
        self.zone.fill(0)

    def _attach(self, voxels: Voxels) -> None:
        self._voxels, device = voxels, self._device
        n_bins = BINS**3
        views, rows, columns = self.zone.shape
        defines = self._defines(voxels)

        def launch(
            name: str, size: tuple[int, ...], local: tuple[int, ...], *args: Array
        ) -> Launch:
            return device.launch(device.kernel("foreground", name, **defines), size, local, *args)

        surface = (self._geometry, voxels.surface, voxels.count)
        seen = (self._floor, voxels.count, self._pictures, self._evidence)
        self._launches = [
            launch(
                "mark",
                (16384 if device.is_gpu else 512, views),
                (64, 1),
                *(self._cameras, self._extents, *surface, self._body),
            ),
            launch(
                "observe",
                (columns, rows, views),
                row_group(device, columns),
                *(self._body, *seen, self.zone, self._counts),
            ),
            launch("fade", (n_bins + 1,), (64,), self._counts, self._memory),
            launch("colour_table", (n_bins,), (64,), self._memory, self.colours),
        ]

    def _defines(self, voxels: Voxels) -> dict[str, int | float]:
        config, (_, rows, columns) = self._config, self.zone.shape
        _, ny, nz = voxels.grid.shape
        return {
            **{"NY": ny, "NZ": nz},
            **{"WIDTH": self._rig.width, "HEIGHT": self._rig.height},
            **{"CELLS_X": columns, "CELLS_Y": rows, "CELL": CELL, "BINS": BINS},
            **{"FLOOR": float(config.floor), "FEET": float(config.feet)},
            **{"MIN_SURFACE": MIN_SURFACE, "MOST": most_samples(self._rig)},
            **{"KEEP": KEEP, "UNIFORM": UNIFORM, "PRIOR": PRIOR},
            "STEPS": float(config.ratio_steps),
            **{"HIPS": HIPS, "STRIDE": STRIDE, "MARGIN": MARGIN},
        }


def cells(rig: CameraRig) -> tuple[int, int]:
    """Rows and columns of cells that cover the largest picture."""
    return -(-rig.height // CELL), -(-rig.width // CELL)


def most_samples(rig: CameraRig) -> int:
    rows, columns = cells(rig)
    return int(MOST * len(rig) * rows * columns)


def follows(before: int, index: int) -> bool:
    """Does the frame `index` come soon after the frame `before`?"""
    return 0 <= index - before <= MAX_GAP


def floor_cells(rig: CameraRig, height: float) -> np.ndarray:
    """(V, rows, columns) bool: cells whose ray meets the floor between the cameras.

    That is, within a circle around the place that they look at, as wide as the farthest one.
    """
    rows, columns = cells(rig)
    middle = axes_meet(rig)[:2]
    radius = np.linalg.norm(rig.centres[:, :2] - middle, axis=1).max()
    u, v = np.meshgrid(np.arange(columns), np.arange(rows))
    pixels = (CELL * np.stack([u, v], -1) + (CELL - 1) / 2).reshape(-1, 1, 2)
    floor = np.zeros((len(rig), rows, columns), bool)
    for view, camera in enumerate(rig):
        plane = cv2.undistortPoints(pixels, camera.K, camera.distortion).reshape(-1, 2)
        rays = np.column_stack([plane, np.ones(len(plane))]) @ camera.R
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (height - camera.centre[2]) / rays[:, 2]
            hits = camera.centre[:2] + distance[:, None] * rays[:, :2]
            near = (np.linalg.norm(hits - middle, axis=1) < radius) & (distance > 0)
        floor[view] = near.reshape(rows, columns)
    return floor
