"""The NumPy twin of `psfs.reconstruct.Reconstructor`."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from cl import Device, NumpyDevice, UserError
from psfs.camera import CameraRig
from psfs.config import ReconstructionConfig, SilhouetteConfig
from psfs.grid import VoxelCloud, VoxelGrid, check_size
from psfs.reconstruct import frame_input
from psfs.reference.colour import surface_colour
from psfs.reference.occupancy import occupancy
from psfs.reference.silhouette import mask_evidence, silhouette_evidence
from psfs.reference.surface import smooth, surface_voxels

if TYPE_CHECKING:
    from psfs.background import Background
    from psfs.sequence import Frame

#: Peak of the float64 computation, measured.
_BYTES_PER_VOXEL = 220


@dataclass(frozen=True, eq=False)
class NumpyVoxels:
    """The voxels of one frame: `probability` (nx, ny, nz), `surface` (N,) flat indices."""

    grid: VoxelGrid
    probability: np.ndarray
    surface: np.ndarray
    occupied: int
    colours: Callable[[], np.ndarray] | None = None

    def cloud(self, colour: bool = False) -> VoxelCloud:
        """The surface voxels, with `colour` in RGB. Raises UserError if there is no picture."""
        if colour and self.colours is None:
            raise UserError("the frame has no pictures to colour its voxels with; expected images")
        rgb = self.colours()[:, :3] if colour and self.colours else None
        probability = self.probability.ravel()[self.surface].astype(np.float32)
        volume = self.occupied * self.grid.voxel_size**3
        return VoxelCloud(self.grid, self.surface, probability, rgb, volume)


class NumpyReconstructor:
    """Same signature and results as `Reconstructor`, computed at once, in float64."""

    def __init__(
        self,
        device: Device | NumpyDevice,
        rig: CameraRig,
        grid: VoxelGrid,
        background: Background | None,
        config: ReconstructionConfig | None = None,
    ) -> None:
        self.device, self.rig, self.grid, self.background = device, rig, grid, background
        self.config = config or ReconstructionConfig()
        check_size(grid)
        needed, there = _BYTES_PER_VOXEL * grid.size, physical_memory()
        if needed > there:
            raise UserError(
                f"a grid of {grid.size:,} voxels needs {needed / 2**20:,.0f} MiB, but this "
                f"machine has {there / 2**20:,.0f} MiB"
            )

    def __call__(self, frame: Frame) -> NumpyVoxels:
        config = self.config.occupancy
        evidence = frame_evidence(frame, self.rig, self.background, self.config.silhouette)
        step = self.config.silhouette.step
        padded = occupancy(self.rig, self.grid, evidence, step, config)
        probability = smooth(padded)
        occupied = probability > config.threshold
        surface = surface_voxels(occupied)
        colours = None
        if frame.images is not None:
            colours = partial(surface_colour, self.rig, self.grid, surface, frame.images, evidence)
        return NumpyVoxels(self.grid, probability, surface, int(occupied.sum()), colours)


def physical_memory() -> int:
    """Bytes of this machine's memory, or a very large number where that cannot be asked."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return sys.maxsize


def frame_evidence(
    frame: Frame, rig: CameraRig, background: Background | None, config: SilhouetteConfig
) -> np.ndarray:
    """Evidence counts (V, H, W) int8 of a frame: of its masks if there is no background."""
    pictures = frame_input(frame, background)
    if background is None:
        return mask_evidence(pictures, rig, config)
    return silhouette_evidence(pictures, rig, background, config)
