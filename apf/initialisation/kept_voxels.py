"""Voxels that stay while later frames are reconstructed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cl import Array, Device, NumpyDevice
from psfs.common.regions import large_parts
from psfs.voxels.device_voxels import Voxels
from psfs.voxels.grid import VoxelCloud, VoxelGrid
from psfs.voxels.host_voxels import HostVoxels


class StoredVoxels:
    """A copy of one frame's surface voxels, of the evidence maps (V, H, W) int8 that they were
    carved with, and of the pictures (V, H, W, 3) uint8 BGR, which trackers can be shown like
    `Voxels`."""

    stays = True

    def __init__(
        self,
        device: Device,
        cloud: VoxelCloud,
        evidence: Array | None = None,
        pictures: Array | None = None,
    ) -> None:
        self.grid = cloud.grid
        self.evidence = evidence
        self._pictures = pictures
        self._cloud = cloud
        indices = cloud.indices if len(cloud.indices) else np.zeros(1)
        self.surface = device.to_device(indices.astype(np.int32), "the surface voxels")
        self.count = device.to_device(np.array([len(cloud.indices)], np.int32))

    def pictures(self) -> Array | None:
        """The frame's pictures, if it has any."""
        return self._pictures

    def cloud(self) -> VoxelCloud:
        """The surface voxels on the host."""
        return self._cloud


def stored(device: Device | NumpyDevice, voxels: Voxels | HostVoxels) -> StoredVoxels | HostVoxels:
    """What remains of `voxels` when their reconstructor goes on to the next frame."""
    if isinstance(device, NumpyDevice):
        assert isinstance(voxels, HostVoxels)
        return replace(voxels, colours=None)
    assert not isinstance(voxels, HostVoxels)

    def kept(array: Array | None) -> Array | None:
        return None if array is None else device.to_device(array.get(), "what a start keeps")

    return StoredVoxels(device, voxels.cloud(), kept(voxels.evidence), kept(voxels.pictures()))


def between(
    device: Device | NumpyDevice, voxels: StoredVoxels | HostVoxels, low: float, high: float
) -> StoredVoxels | HostVoxels:
    """Return those of the surface voxels whose z lies between `low` and `high`, m."""
    cloud = voxels.cloud()
    kept = (cloud.centres[:, 2] >= low) & (cloud.centres[:, 2] <= high)
    if not isinstance(voxels, StoredVoxels):
        return replace(voxels, surface=voxels.surface[kept])
    assert isinstance(device, Device)
    parts = replace(cloud, indices=cloud.indices[kept], probability=cloud.probability[kept])
    return StoredVoxels(device, parts, voxels.evidence, voxels.pictures())


def person_points(grid: VoxelGrid, indices: np.ndarray, min_part: float = 0.05) -> np.ndarray:
    """Return the centres (N, 3) m of the voxels in connected parts of at least the share `min_part`
    of the largest."""
    if len(indices) == 0:
        return np.zeros((0, 3))
    filled = np.zeros(grid.shape, bool)
    filled.ravel()[indices] = True
    return grid.centres(indices[large_parts(filled, min_part).ravel()[indices]])
