"""Agreement of voxel clouds with the silhouettes that they were carved from."""

from __future__ import annotations

from collections.abc import Sequence as Items
from functools import reduce

import cv2
import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.rig_geometry import voxel_footprints
from psfs.common.numbers import known_means
from psfs.common.progress import map_in_threads
from psfs.common.regions import bounding_box, iou, keep_large_regions
from psfs.diagnostics.config import SPECKLE_SHARE
from psfs.sequence import Frame
from psfs.session import Session
from psfs.silhouettes.hidden import UNKNOWN
from psfs.voxels.grid import VoxelCloud, VoxelGrid
from psfs.voxels.host_voxels import voxel_silhouette

#: Least share of a part that must lie within the volume for the part to count whole.
_MOSTLY = 0.4
#: Distance, px, between the rays that are compared with the volume.
_RAY_SPACING = 4


class Checker:
    """`checker(frame, cloud)`: (V,) IoU per camera, as defined in `config.DEFINITION`; NaN if
    both the frame's silhouette and the reprojected cloud are empty.

    The silhouettes are those of the session's reconstruction in this grid. It is repeated, so the
    appearance model is fitted again: give the frames in the run's order, since a frame given alone
    uses only itself. known: (V, H, W) bool, false where furniture hides what is behind it, for the
    frame whose silhouettes were asked for last.
    """

    known: np.ndarray

    def __init__(self, session: Session, grid: VoxelGrid) -> None:
        self.rig = session.rig
        self.beyond: list[np.ndarray] = []  # (V,) `share_beyond_volume` of every frame so far
        self._reconstruct = session.reconstructor(grid)
        self._volume = volume_region(self.rig, grid)
        self._extents = voxel_footprints(self.rig, grid.voxel_size)

    def silhouettes(self, frame: Frame) -> np.ndarray:
        """Return (V, H, W) bool: the frame's silhouettes without speckle; parts cut by the volume
        are whole, see `whole_silhouettes`."""
        self._reconstruct(frame)
        evidence = self._reconstruct.evidence()
        self.known = evidence != UNKNOWN
        whole = whole_silhouettes(evidence > 0, self._volume)
        self.beyond.append(share_beyond_volume(whole, self._volume))
        return whole

    def __call__(self, frame: Frame, cloud: VoxelCloud) -> np.ndarray:
        silhouettes = self.silhouettes(frame)
        return score_voxels(self.rig, self._extents, cloud.centres, silhouettes, self.known)


def score_voxels(
    rig: CameraRig,
    extents: np.ndarray,
    centres: np.ndarray,
    silhouettes: np.ndarray,
    known: np.ndarray,
) -> np.ndarray:
    """Return the IoU (V,) of voxels with `centres` (N, 3) m, of `extents` (see `voxel_footprints`),
    and the silhouettes (V, H, W) bool, at pixels that are `known` (V, H, W)."""
    scores = []
    for camera, extent, shown, there in zip(rig, extents, silhouettes, known, strict=True):
        voxels = voxel_silhouette(camera, centres, extent, shown.shape)
        scores.append(iou(voxels & there, shown))
    return np.array(scores)


def whole_silhouettes(silhouettes: np.ndarray, region: np.ndarray) -> np.ndarray:
    """Return the silhouettes (V, H, W) bool of what is in the volume, whose projection is `region`.

    Parts of which a share of at least `_MOSTLY` lies within `region` count whole, others only
    within it. Speckle is removed.
    """
    return np.stack([_complete(*pair) for pair in zip(silhouettes, region, strict=True)])


def _complete(silhouette: np.ndarray, region: np.ndarray) -> np.ndarray:
    rows, columns = bounding_box(silhouette) or (slice(0, 1), slice(0, 1))
    top, left = max(0, rows.start - 2), max(0, columns.start - 2)
    box = np.s_[top : rows.stop + 2, left : columns.stop + 2]  # with the rim that the filter sees
    inside, whole = region[box], np.zeros(silhouette.shape, bool)
    smooth = cv2.medianBlur(silhouette[box].view(np.uint8), 5)
    count, labels, sizes, _ = cv2.connectedComponentsWithStats(smooth, connectivity=8)
    within = np.bincount(labels[inside], minlength=count)
    mostly = within >= _MOSTLY * sizes[:, cv2.CC_STAT_AREA]
    kept_pixels = smooth.view(bool) & (inside | mostly[labels])
    whole[box] = keep_large_regions(kept_pixels, SPECKLE_SHARE)
    return whole


def share_beyond_volume(silhouettes: np.ndarray, region: np.ndarray) -> np.ndarray:
    """Return the share (V,) of the silhouettes (V, H, W) that lies beyond the volume; NaN for an
    empty one."""
    areas = silhouettes.sum(axis=(1, 2)).astype(float)
    return (silhouettes & ~region).sum(axis=(1, 2)) / np.where(areas > 0, areas, np.nan)


def describe_cut_silhouettes(names: Items[str], beyond: np.ndarray) -> str | None:
    """Return a warning if silhouettes reach beyond the volume; `beyond`: shares (frames, V)."""
    shares = np.nan_to_num(known_means(beyond))
    cut = [
        f"{name} {share:.0%}"
        for name, share in zip(names, shares, strict=True)
        if share > SPECKLE_SHARE
    ]
    if not cut:
        return None
    return (
        f"the volume cuts what is filmed: of the silhouettes lie beyond it {', '.join(cut)}; state "
        "a larger --volume, or --subject object for what does not stand on the floor z = 0"
    )


def volume_region(rig: CameraRig, grid: VoxelGrid) -> np.ndarray:
    """Return (V, H, W) bool: pixels that look into the volume."""
    shape = rig.height, rig.width
    return np.stack(list(map_in_threads(lambda camera: _hits_box(camera, grid, shape), rig)))


def _hits_box(camera: Camera, grid: VoxelGrid, shape: tuple[int, int]) -> np.ndarray:
    """Return the pixels (H, W) bool whose ray meets the box (slab method). Squares of pixels with
    sides of `_RAY_SPACING` share one ray."""
    (width, height), region = camera.size, np.zeros(shape, bool)
    u, v = np.meshgrid(
        *(np.arange(0, side, _RAY_SPACING) + _RAY_SPACING / 2 for side in camera.size)
    )
    directions = camera.rays(np.stack([u, v], -1).reshape(-1, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        to_low = (grid.low - camera.centre) / directions
        to_high = (grid.high - camera.centre) / directions
    # By pairs of columns: NumPy's nanmax takes several times as long.
    enter = reduce(np.fmax, np.minimum(to_low, to_high).T)
    leave = reduce(np.fmin, np.maximum(to_low, to_high).T)
    met = ((leave >= enter) & (leave > 0)).reshape(u.shape)
    region[:height, :width] = met.repeat(_RAY_SPACING, 0).repeat(_RAY_SPACING, 1)[:height, :width]
    return region
