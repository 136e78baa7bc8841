"""Copies of a frame's voxels that stay valid while later frames are reconstructed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from apf.likelihood.observations import AnyVoxels
from cl import Array, Device, Launch, NumpyDevice
from cl.staging import Copy, Upload
from psfs.common.regions import bounding_box, split_regions
from psfs.voxels.grid import VoxelCloud, VoxelGrid
from psfs.voxels.host_voxels import HostVoxels


class StoredVoxels:
    """A copy of one frame's surface voxels, of the evidence maps (V, H, W) int8 that they were
    carved with, and of the images (V, H, W, 3) uint8 BGR. Trackers accept it like `Voxels`."""

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
        """Return the frame's images, if it has any."""
        return self._pictures

    def cloud(self) -> VoxelCloud:
        """Return the surface voxels on the host."""
        return self._cloud


def store_voxels(device: Device | NumpyDevice, voxels: AnyVoxels) -> StoredVoxels | HostVoxels:
    """Return a copy of `voxels` that stays valid when their reconstructor goes on to the next
    frame."""
    if isinstance(device, NumpyDevice):
        assert isinstance(voxels, HostVoxels)
        return replace(voxels, colours=None)
    assert not isinstance(voxels, HostVoxels)

    def kept(array: Array | None) -> Array | None:
        if array is None:
            return None
        copy = device.empty(array.shape, array.dtype, "what a start keeps")
        Copy(array, copy)()
        return copy

    return StoredVoxels(device, voxels.cloud(), kept(voxels.evidence), kept(voxels.pictures()))


#: Fewest surface voxels that can be a person.
LEAST_VOXELS = 200
#: Share of the largest connected part below which another one is debris, unless it is within so
#: many m of it on the floor.
_LEAST_PART, _BESIDE = 0.05, 0.15
#: Margin around the foreground that is kept, as share of the images' larger side; a body that fits
#: does not reach farther.
_MARGIN = 0.05
#: Work-items of a GPU for one image row.
_LANES = 64


@dataclass(frozen=True, eq=False)
class CroppedVoxels:
    """A frame's surface voxels on the host, with its evidence maps and images cropped to the
    foreground in each camera. It takes a fifth of the memory, for many frames that are held at
    once.

    shape: (H, W) of the images. parts: (V, 5) int32: first row and column, numbers of rows and
    columns, and the offset in `pixels` (n,) uint8. There lies the evidence (h, w) int8, followed,
    if the frames have `pictures`, by the image (h, w, 3).
    """

    cloud: VoxelCloud
    shape: tuple[int, int]
    parts: np.ndarray
    pixels: np.ndarray
    pictures: bool

    @property
    def nbytes(self) -> int:
        """Size of maps and images, bytes."""
        return self.pixels.nbytes


def crop_voxels(
    cloud: VoxelCloud, evidence: np.ndarray, pictures: np.ndarray | None
) -> CroppedVoxels:
    """Return a frame's surface voxels with its evidence maps (V, H, W) int8 and images (V, H, W, 3)
    uint8 cropped to the foreground."""
    height, width = evidence.shape[1:]
    margin = round(_MARGIN * max(height, width))
    parts, kept, place = [], list[np.ndarray](), 0
    for view, of in enumerate(evidence):
        # Without foreground one pixel stands for the whole map.
        rows, columns = bounding_box(of > 0) or (slice(0, 1), slice(0, 1))
        top, left = max(0, rows.start - margin), max(0, columns.start - margin)
        part = slice(top, rows.stop + margin), slice(left, columns.stop + margin)
        parts.append((top, left, *of[part].shape, place))
        kept.append(of[part].view(np.uint8))
        if pictures is not None:
            kept.append(pictures[view][part])
        place += of[part].size * (1 if pictures is None else 4)
    table, pixels = np.array(parts, np.int32), np.concatenate(kept, axis=None)
    return CroppedVoxels(cloud, (height, width), table, pixels, pictures is not None)


class RestoredVoxels:
    """One kept frame at a time, restored on the device. Trackers accept it like `Voxels`; the next
    frame overwrites it. Its buffers are large enough for any of `frames`.

    `show(frame)` enqueues the kernel that restores the frame from its crops. Outside a crop, maps
    and images repeat its border pixels. Kernel: common/uncrop.cl; twin: `uncrop` in
    reference/likelihood/voxel.py.
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
        """Enqueue the restoration of `frame`."""
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
        """Return the frame's images, if it has any."""
        return self._pictures

    def cloud(self) -> VoxelCloud:
        """Return the surface voxels on the host."""
        return self._cloud

    def _launch(self, whole: Array, channels: int) -> Launch:
        views, height, width = self.evidence.shape
        lanes = _LANES if self._device.is_gpu else 1
        kernel = self._device.kernel("common/uncrop", "uncrop", CHANNELS=channels, LANES=lanes)
        return self._device.launch(
            kernel, (lanes, height, views), (lanes, 1, 1), width=width, parts=self._parts,
            kept=self._pixels, whole=whole,
        )  # fmt: skip


def cut_by_height(
    device: Device | NumpyDevice, voxels: AnyVoxels, low: float, high: float
) -> StoredVoxels | HostVoxels:
    """Return the surface voxels with z between `low` and `high`, m."""
    cloud = voxels.cloud()
    kept = (cloud.centres[:, 2] >= low) & (cloud.centres[:, 2] <= high)
    if isinstance(voxels, HostVoxels):
        return replace(voxels, surface=voxels.surface[kept])
    assert isinstance(device, Device)
    parts = replace(cloud, indices=cloud.indices[kept], probability=cloud.probability[kept])
    return StoredVoxels(device, parts, voxels.evidence, voxels.pictures())


def shows_somebody(voxels: AnyVoxels) -> bool:
    """Return whether a frame has enough surface voxels to be of a person."""
    return len(voxels.cloud().indices) >= LEAST_VOXELS


def select_person_points(grid: VoxelGrid, indices: np.ndarray) -> np.ndarray:
    """Return the centres (N, 3) m of the person's voxels: the largest connected component, other
    components too large to be debris, and those close to these on the floor, such as a head whose
    neck is missing in the silhouettes, or feet whose calves are."""
    parts = split_regions(np.sort(indices), grid.shape)
    if not parts:
        return np.zeros((0, 3))
    large = [part for part in parts if len(part) >= _LEAST_PART * len(parts[0])]
    small = parts[len(large) :]
    if small:
        tree = scipy.spatial.cKDTree(grid.centres(np.concatenate(large))[:, :2])
        large += [p for p in small if tree.query(grid.centres(p)[:, :2])[0].min() < _BESIDE]
    return grid.centres(np.sort(np.concatenate(large)))
