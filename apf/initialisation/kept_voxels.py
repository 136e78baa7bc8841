"""Voxels that stay while later frames are reconstructed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from cl import Array, Device, NumpyDevice
from psfs.common.regions import bounding_box, large_parts
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


#: Pixels about the foreground that are kept, share of the pictures' larger side: farther away no
#: body is looked for that fits.
_MARGIN = 0.05


@dataclass(frozen=True, eq=False)
class CroppedVoxels:
    """A frame's surface voxels on the host, with the part of its evidence maps and pictures about
    the foreground, of each camera: for many frames that are held at once, a fifth of the memory.

    shape: (H, W) of the pictures. corners: (V, 2) row and column of the first pixel of each part;
    evidence: V of (h, w) int8; pictures: V of (h, w, 3) uint8, None where there are none.
    """

    cloud: VoxelCloud
    shape: tuple[int, int]
    corners: np.ndarray
    evidence: Sequence[np.ndarray]
    pictures: Sequence[np.ndarray] | None

    @property
    def nbytes(self) -> int:
        """Bytes of maps and pictures."""
        return sum(part.nbytes for part in (*self.evidence, *(self.pictures or ())))

    def restored(self, device: Device) -> StoredVoxels:
        """Return the voxels as they were; away from the foreground maps and pictures go on as they
        are at the rim of what was kept."""

        def whole(parts: Sequence[np.ndarray]) -> Array:
            full = np.empty((len(parts), *self.shape, *parts[0].shape[2:]), parts[0].dtype)
            for out, (top, left), part in zip(full, self.corners.tolist(), parts, strict=True):
                below = self.shape[0] - top - part.shape[0]
                right = self.shape[1] - left - part.shape[1]
                border = (top, below, left, right, cv2.BORDER_REPLICATE)
                cv2.copyMakeBorder(part, *border, dst=out)
            return device.to_device(full, "a kept frame")

        pictures = None if self.pictures is None else whole(self.pictures)
        return StoredVoxels(device, self.cloud, whole(self.evidence), pictures)


def cropped(
    device: Device | NumpyDevice, voxels: Voxels | HostVoxels
) -> CroppedVoxels | StoredVoxels | HostVoxels:
    """What remains of `voxels` in little memory when their reconstructor goes on to the next frame;
    those of NumPy, and those carved without maps, as `stored` has them."""
    if isinstance(voxels, HostVoxels) or voxels.evidence is None:
        return stored(device, voxels)
    evidence = voxels.evidence.get()
    pictures = None if voxels.frame is None else voxels.frame.images
    height, width = evidence.shape[1:]
    margin = round(_MARGIN * max(height, width))
    corners, parts, shown = [], [], []
    for view, of in enumerate(evidence):
        # Nobody: a corner says what all of it is.
        rows, columns = bounding_box(of > 0) or (slice(0, 1), slice(0, 1))
        top, left = max(0, rows.start - margin), max(0, columns.start - margin)
        part = slice(top, rows.stop + margin), slice(left, columns.stop + margin)
        corners.append((top, left))
        parts.append(of[part].copy())
        if pictures is not None:
            shown.append(pictures[view][part].copy())
    return CroppedVoxels(
        voxels.cloud(), (height, width), np.array(corners), parts,
        None if pictures is None else shown,
    )  # fmt: skip


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
