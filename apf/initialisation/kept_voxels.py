"""Voxels that stay while later frames are reconstructed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from apf.initialisation.config import FrameChoice
from cl import Array, Device, Launch, NumpyDevice
from cl.staging import Upload
from psfs.common.regions import bounding_box, find_connected_regions
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
#: Items of a GPU for a row of a picture.
_LANES = 64


@dataclass(frozen=True, eq=False)
class CroppedVoxels:
    """A frame's surface voxels on the host, with the part of its evidence maps and pictures about
    the foreground, of each camera: for many frames that are held at once, a fifth of the memory.

    shape: (H, W) of the pictures. parts: (V, 5) int32, first row and column, rows and columns, and
    where the part begins in `pixels` (n,) uint8: its evidence (h, w) int8 and behind it, where
    frames have `pictures`, its picture (h, w, 3).
    """

    cloud: VoxelCloud
    shape: tuple[int, int]
    parts: np.ndarray
    pixels: np.ndarray
    pictures: bool

    @property
    def nbytes(self) -> int:
        """Bytes of maps and pictures."""
        return self.pixels.nbytes


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
    parts, kept, place = [], list[np.ndarray](), 0
    for view, of in enumerate(evidence):
        # Nobody: a corner says what all of it is.
        rows, columns = bounding_box(of > 0) or (slice(0, 1), slice(0, 1))
        top, left = max(0, rows.start - margin), max(0, columns.start - margin)
        part = slice(top, rows.stop + margin), slice(left, columns.stop + margin)
        parts.append((top, left, *of[part].shape, place))
        kept.append(of[part].view(np.uint8))
        if pictures is not None:
            kept.append(pictures[view][part])
        place += of[part].size * (1 if pictures is None else 4)
    table, pixels = np.array(parts, np.int32), np.concatenate(kept, axis=None)
    return CroppedVoxels(voxels.cloud(), (height, width), table, pixels, pictures is not None)


class RestoredVoxels:
    """One of the frames that were kept at a time, on the device, where trackers can be shown it
    like `Voxels`; the next one overwrites it. There is room for any of `frames`.

    `show(frame)` enqueues what makes it of the kept parts. Away from the foreground maps and
    pictures go on as they are at the rim of what was kept. Kernel: common/uncrop.cl; twin:
    reference/kept_voxels.py.
    """

    stays = False

    def __init__(self, device: Device, frames: Sequence[CroppedVoxels]) -> None:
        self._device, first = device, frames[0]
        views, shape = len(first.parts), first.shape
        what = "a kept frame"
        n_pixels = max(frame.pixels.size for frame in frames)
        self._pixels = device.empty(n_pixels, np.uint8, what)
        self._parts = device.empty(first.parts.shape, np.int32)
        n_surface = max(1, *(len(frame.cloud) for frame in frames))
        self.surface = device.empty(n_surface, np.int32, what)
        self.count = device.empty(1, np.int32)
        self.evidence = device.empty((views, *shape), np.int8, what)
        self._pictures = (
            device.empty((views, *shape, 3), np.uint8, what) if first.pictures else None
        )
        self._uploads = Upload(self._pixels), Upload(self.surface)
        self._launches = [self._launch(self.evidence.view(np.uint8), 1)]
        if self._pictures is not None:
            self._launches.append(self._launch(self._pictures, 3))

    def show(self, frame: CroppedVoxels) -> RestoredVoxels:
        """Enqueue what makes these the voxels of `frame`."""
        self._cloud, self.grid = frame.cloud, frame.cloud.grid
        self._parts.set(frame.parts)
        self.count.set(np.array([len(frame.cloud)], np.int32))
        for upload, numbers in zip(self._uploads, (frame.pixels, frame.cloud.indices), strict=True):
            upload.room()[: numbers.size] = numbers
            upload.start(max(1, numbers.size))
        for launch in self._launches:
            launch()
        return self

    def pictures(self) -> Array | None:
        """The frame's pictures, if it has any."""
        return self._pictures

    def cloud(self) -> VoxelCloud:
        """The surface voxels on the host."""
        return self._cloud

    def _launch(self, whole: Array, channels: int) -> Launch:
        views, height, width = self.evidence.shape
        lanes = _LANES if self._device.is_gpu else 1
        kernel = self._device.kernel("common/uncrop", "uncrop", CHANNELS=channels, LANES=lanes)
        return self._device.launch(
            kernel, (lanes, height, views), (lanes, 1, 1), width=width, parts=self._parts,
            kept=self._pixels, whole=whole,
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


def person_points(
    grid: VoxelGrid, indices: np.ndarray, config: FrameChoice | None = None
) -> np.ndarray:
    """Return the centres (N, 3) m of the voxels of the largest connected part, of others that are
    no debris, and of smaller ones close to these: a head of which the pictures lost the neck."""
    config = config or FrameChoice()
    filled = np.zeros(grid.shape, bool)
    filled.ravel()[indices] = True
    parts = find_connected_regions(filled)
    if not parts:
        return np.zeros((0, 3))
    large = [part for part in parts if len(part) >= config.min_part * len(parts[0])]
    tree = cKDTree(grid.centres(np.concatenate(large)))
    small = [p for p in parts[len(large) :] if len(p) >= config.min_near_part * len(parts[0])]
    near = [p for p in small if tree.query(grid.centres(p))[0].min() < config.near]
    return grid.centres(np.sort(np.concatenate([*large, *near])))
