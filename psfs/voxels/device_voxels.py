"""The voxels of the latest frame on an OpenCL device."""

from __future__ import annotations

from collections.abc import Callable
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
    to one frame and are never overwritten. The argument `pictures` returns the pictures of a frame
    on the device.
    """

    stays = False

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        grid: VoxelGrid,
        evidence: Array,
        surface: SparseSurface,
        pictures: Callable[[Frame | None], Array | None],
    ) -> None:
        self.grid = grid
        self._pictures_of = pictures
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
        return self._pictures_of(self._frame)

    def cloud(self, colour: bool = False) -> VoxelCloud:
        """Download the surface voxels, in RGB if `colour` is true; waits for the device.

        Raises InputError if there was no room for all voxels, or if there is no picture to colour
        them.
        """
        indices, probability, occupied = self._surface.download()
        rgb = self.colours().get(len(indices))[:, :3] if colour else None
        volume = occupied * self.grid.voxel_size**3
        return VoxelCloud(self.grid, indices, probability, rgb, volume)


def find_pictures(silhouette: Silhouette) -> Callable[[Frame | None], Array | None]:
    """Return the function of `Voxels` that returns the pictures of a frame on the device: they are
    uploaded if silhouettes come from masks, and are there already otherwise."""
    room: list[Array] = []

    def pictures(frame: Frame | None) -> Array | None:
        if frame is None or frame.images is None:
            return None
        if silhouette.background is not None:
            return silhouette.input
        if not room:
            room.append(silhouette.device.empty(frame.images.shape, np.uint8, "the pictures"))
        room[0].set(frame.images)
        return room[0]

    return pictures
