"""The voxels of one frame on the host, and the functions of voxels that run there in production."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cl import InputError
from psfs.cameras.camera import Camera
from psfs.cameras.rig_geometry import pixel_boxes
from psfs.voxels.grid import VoxelCloud, VoxelGrid


@dataclass(frozen=True, eq=False)
class HostVoxels:
    """The voxels of one frame.

    probability: (nx, ny, nz). surface: (N,) flat indices. If known: the evidence maps (V, H, W)
    int8 that they were carved with, and the pictures (V, H, W, 3) uint8 BGR.
    """

    grid: VoxelGrid
    probability: np.ndarray
    surface: np.ndarray
    occupied: int
    colours: Callable[[], np.ndarray] | None = None
    evidence: np.ndarray | None = None
    pictures: np.ndarray | None = None

    def download_evidence(self) -> np.ndarray | None:
        """Return the evidence maps, as `Voxels.download_evidence` does."""
        return self.evidence

    def cloud(self, colour: bool = False) -> VoxelCloud:
        """Return the surface voxels, in RGB if `colour` is true. Raises InputError if that lacks a
        picture."""
        if colour and self.colours is None:
            raise InputError("the frame has no pictures to colour its voxels with; expected images")
        rgb = self.colours()[:, :3] if colour and self.colours else None
        probability = self.probability.ravel()[self.surface].astype(np.float32)
        volume = self.occupied * self.grid.voxel_size**3
        return VoxelCloud(self.grid, self.surface, probability, rgb, volume)


def voxel_silhouette(
    camera: Camera, centres: np.ndarray, footprint: np.ndarray, shape: tuple[int, int]
) -> np.ndarray:
    """Return the silhouette (H, W) bool of voxels with `centres` (N, 3) m in a picture of `shape`.

    footprint: (2,) px m, see `psfs.cameras.rig_geometry.voxel_footprints`.
    """
    low, high, _ = pixel_boxes(camera, centres, footprint)
    drawn = np.zeros(shape, bool)
    if not len(low):
        return drawn
    (left, top), (right, bottom) = low.min(0), high.max(0)
    (x0, y0), (x1, y1) = (low - (left, top)).T, (high - (left, top)).T
    # Signed corners of the boxes: their sums along both axes count the boxes over each pixel.
    size = bottom - top + 1, right - left + 1
    begun, ended = (
        np.bincount(np.concatenate(places), minlength=size[0] * size[1]).reshape(size)
        for places in (
            (y0 * size[1] + x0, y1 * size[1] + x1), (y0 * size[1] + x1, y1 * size[1] + x0)
        )
    )  # fmt: skip
    drawn[top:bottom, left:right] = (begun - ended).cumsum(0).cumsum(1)[:-1, :-1] > 0
    return drawn
