"""From a frame's pictures to its voxels, on one device."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from cl import Array, Device, NumpyDevice, UserError
from psfs.camera import CameraRig
from psfs.config import ReconstructionConfig
from psfs.grid import VoxelCloud, VoxelGrid
from psfs.occupancy import Occupancy
from psfs.silhouette import Silhouette
from psfs.surface import Surface

if TYPE_CHECKING:
    from psfs.background import Background
    from psfs.reference.reconstruct import NumpyReconstructor
    from psfs.sequence import Frame


class HasCloud(Protocol):
    """What the voxels of either reconstructor offer."""

    @property
    def grid(self) -> VoxelGrid: ...

    def cloud(self) -> VoxelCloud: ...


class Voxels:
    """The voxels of the latest frame, on the device; overwritten by the next frame.

    probability: (nx, ny, nz) float32, smoothed. surface: (capacity,) int32 flat indices, of which
    the first `count[0]` are valid, ascending. count, occupied: (1,) int32.
    """

    def __init__(self, grid: VoxelGrid, surface: Surface) -> None:
        self.grid = grid
        self.probability: Array = surface.probability
        self.surface: Array = surface.surface
        self.count: Array = surface.count
        self.occupied: Array = surface.occupied
        self._surface = surface

    def cloud(self) -> VoxelCloud:
        """Download the surface voxels (waits for the device)."""
        count = int(self.count.get()[0])
        volume = int(self.occupied.get()[0]) * self.grid.voxel_size**3
        probability = self._surface.surface_probability(count)
        return VoxelCloud(self.grid, self.surface.get(count), probability, None, volume)


class Reconstructor:
    """Probabilistic shape from silhouette: `voxels = reconstructor(frame)`.

    `background` None takes the frames' masks for silhouettes. A call only enqueues work; nothing
    comes back to the host until somebody asks for `voxels.cloud()`.
    """

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        grid: VoxelGrid,
        background: Background | None,
        config: ReconstructionConfig | None = None,
    ) -> None:
        config = config or ReconstructionConfig()
        self.device, self.rig, self.config = device, rig, config
        self.silhouette = Silhouette(device, rig, background, config.silhouette)
        self.occupancy = Occupancy(
            device, rig, grid, self.silhouette.evidence, config.silhouette.step, config.occupancy
        )
        self.surface = Surface(
            device, grid.shape, self.occupancy.probability, config.occupancy.threshold
        )
        self.voxels = Voxels(grid, self.surface)

    @property
    def grid(self) -> VoxelGrid:
        return self.voxels.grid

    def place(self, grid: VoxelGrid) -> None:
        """Move to a grid of the same shape, from the next frame on. Raises UserError otherwise."""
        if grid.shape != self.grid.shape:
            raise UserError(f"the new grid has shape {grid.shape}; expected {self.grid.shape}")
        self.occupancy.place(grid)
        self.voxels.grid = grid

    def __call__(self, frame: Frame) -> Voxels:
        """Enqueue the reconstruction of `frame`. Raises UserError if it lacks what is needed."""
        self.silhouette(frame_input(frame, self.silhouette.background))
        self.occupancy()
        self.surface()
        return self.voxels


def frame_input(frame: Frame, background: Background | None) -> np.ndarray:
    """The frame's pictures, or its masks if there is no background. Raises UserError if absent."""
    pictures = frame.masks if background is None else frame.images
    if pictures is None:
        kind = "masks" if background is None else "pictures"
        raise UserError(f"frame {frame.index} has no {kind}, which its silhouettes are made of")
    return pictures


def reconstructor_for(
    device: Device | NumpyDevice,
    rig: CameraRig,
    grid: VoxelGrid,
    background: Background | None,
    config: ReconstructionConfig | None = None,
) -> Reconstructor | NumpyReconstructor:
    """The reconstructor of the chosen device: OpenCL, or the NumPy twin."""
    if isinstance(device, NumpyDevice):
        from psfs.reference.reconstruct import NumpyReconstructor

        return NumpyReconstructor(device, rig, grid, background, config)
    return Reconstructor(device, rig, grid, background, config)
