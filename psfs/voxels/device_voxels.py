"""The voxels of the latest frame on an OpenCL device."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from cl import Array, Device, InputError
from psfs.cameras.camera import CameraRig
from psfs.sequence import Frame
from psfs.silhouettes.silhouette import Silhouette
from psfs.voxels.colour import SurfaceColour
from psfs.voxels.grid import VoxelCloud, VoxelGrid
from psfs.voxels.sparse import SparseSurface


class CarvedVoxels(Protocol):
    """Part of `Voxels` that trackers use, and that copies of a frame's voxels on the device have,
    too."""

    @property
    def grid(self) -> VoxelGrid: ...

    @property
    def surface(self) -> Array: ...

    @property
    def count(self) -> Array: ...

    @property
    def evidence(self) -> Array | None: ...

    @property
    def stays(self) -> bool: ...

    def pictures(self) -> Array | None: ...

    def cloud(self) -> VoxelCloud: ...


class Voxels:
    """The surface voxels of the latest frame, on the device; overwritten by the next frame.

    surface: (capacity,) int32 flat indices, ascending, of which the first `count[0]` are valid.
    count, occupied: (1,) int32. evidence: (V, H, W) int8 evidence maps that the voxels were carved
    with, above 0 where foreground is likelier; also overwritten. stays: whether the voxels belong
    to one frame and are never overwritten.
    """

    stays = False

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        grid: VoxelGrid,
        evidence: Array,
        surface: SparseSurface,
    ) -> None:
        self.grid = grid
        self._counts: np.ndarray | None = None
        self.frame = None
        self.surface: Array = surface.list.indices
        self.count: Array = surface.list.count
        self.occupied: Array = surface.list.occupied
        self.evidence: Array | None = evidence
        self._device, self._rig, self._maps, self._surface = device, rig, evidence, surface
        self._colour: SurfaceColour | None = None

    @property
    def frame(self) -> Frame | None:
        """The frame that is reconstructed; None before the first one."""
        return self._frame

    @frame.setter
    def frame(self, frame: Frame | None) -> None:
        self._frame, self._counts = frame, None

    def download_evidence(self) -> np.ndarray | None:
        """Return the frame's evidence (V, H, W) int8, which is downloaded once."""
        if self._counts is None and self.evidence is not None:
            self._counts = self.evidence.get()
        return self._counts

    @property
    def probability(self) -> Array:
        """Smoothed occupancy (nx, ny, nz) float32, see `SparseSurface.probability`."""
        return self._surface.probability

    def colours(self) -> Array:
        """Enqueue the surface's colours (capacity, 4) uint8: RGB and the number of cameras in the
        mean.

        Raises InputError if the frame has no pictures.
        """
        pictures = self.pictures()
        if pictures is None:
            raise InputError("the frame has no pictures to colour its voxels with; expected images")
        if self._colour is None:
            self._colour = SurfaceColour(
                self._device, self._rig, self.grid, self._surface.list, self._maps
            )
        return self._colour(self.grid, pictures)

    def pictures(self) -> Array | None:
        """Return the frame's pictures (V, H, W, 3) uint8 BGR on the device, None if it has none."""
        return None

    def cloud(self, colour: bool = False) -> VoxelCloud:
        """Download the surface voxels, in RGB if `colour` is true; waits for the device.

        Raises InputError if there was no room for all voxels, or if there is no picture to colour
        them.
        """
        count = int(self.count.get()[0])
        self._surface.list.check_room()
        volume = int(self.occupied.get()[0]) * self.grid.voxel_size**3
        probability = self._surface.surface_probability(count)
        rgb = self.colours().get(count)[:, :3] if colour else None
        return VoxelCloud(self.grid, self.surface.get(count), probability, rgb, volume)


class SilhouetteVoxels(Voxels):
    """The voxels that a reconstructor carved from its silhouettes."""

    def __init__(self, grid: VoxelGrid, silhouette: Silhouette, surface: SparseSurface) -> None:
        super().__init__(silhouette.device, silhouette.rig, grid, silhouette.evidence, surface)
        self._silhouette = silhouette
        self._images: Array | None = None

    def pictures(self) -> Array | None:
        """Return the frame's pictures (V, H, W, 3) uint8 BGR on the device, None if it has none.

        They are uploaded if silhouettes come from masks, and are on the device already otherwise.
        """
        images = None if self.frame is None else self.frame.images
        if images is None:
            return None
        if self._silhouette.background is not None:
            return self._silhouette.input
        if self._images is None:
            self._images = self._silhouette.device.empty(images.shape, np.uint8, "the pictures")
        self._images.set(images)
        return self._images
