"""Agreement of voxel clouds with true masks, compared with clouds that the same grid would give if
the true masks were the silhouettes."""

from __future__ import annotations

from collections.abc import Sequence as Items
from dataclasses import dataclass

import cv2
import numpy as np
import scipy

from psfs.cameras.camera import Camera, CameraRig
from psfs.common.numbers import mean_known
from psfs.common.regions import iou
from psfs.voxels.grid import VoxelCloud, VoxelGrid

DEFINITION = (
    "iou: of the true masks with the cloud, whose surface voxels are drawn as discs of half their "
    "projected size; ceiling: the same for all voxels of the grid that lie in every true mask; "
    "ghosts: share of the cloud's voxels that are none of those, nor neighbours of one; volume: "
    "iou of the voxels within the cloud's surface with those that lie in every true mask, of those "
    "that all cameras with a true mask see"
)


#: The scores of a cloud.
NAMES = ("iou", "ceiling", "ghosts", "volume")


@dataclass(frozen=True)
class CloudScore:
    """The scores of a frame's cloud, means over the cameras with a true mask, as `DEFINITION`
    says. NaN where there is nothing to compare."""

    iou: float
    ceiling: float
    ghosts: float
    volume: float


def score_cloud(rig: CameraRig, cloud: VoxelCloud, truth: Items[np.ndarray | None]) -> CloudScore:
    """Return the scores of a frame's cloud, given the true masks (H, W) bool of the cameras."""
    seen = [(camera, mask) for camera, mask in zip(rig, truth, strict=True) if mask is not None]
    grid = cloud.grid
    hull = _carve(seen, grid)
    ours, best = (
        [
            iou(draw_voxels(camera, points, grid.voxel_size, mask.shape), mask)
            for camera, mask in seen
        ]
        for points in (cloud.centres, grid.centres(hull))
    )
    in_hull = np.zeros(grid.shape, bool)
    in_hull.ravel()[hull] = True
    hull_and_rim = scipy.ndimage.binary_dilation(in_hull, np.ones((3, 3, 3)))
    ghosts = float(1 - hull_and_rim.ravel()[cloud.indices].mean()) if len(cloud) else float("nan")
    return CloudScore(mean_known(ours), mean_known(best), ghosts, _volume_iou(seen, cloud, in_hull))


def mean_scores(scores: Items[CloudScore]) -> dict[str, float | None]:
    """Return the mean of each score over frames, None where it is unknown."""
    means = {name: mean_known([getattr(score, name) for score in scores]) for name in NAMES}
    return {name: None if np.isnan(mean) else mean for name, mean in means.items()}


def draw_voxels(
    camera: Camera, points: np.ndarray, edge: float, shape: tuple[int, ...]
) -> np.ndarray:
    """Return the pixels `shape` (H, W) bool that the voxels cover, of `edge` m around `points` (N,
    3): each a disc of half its projected size."""
    _, row, column, depth = camera.look_up(points)
    radii = np.maximum(1, np.round(0.5 * edge * camera.K[0, 0] / depth)).astype(int)
    drawn = np.zeros(shape, bool)
    for radius in np.unique(radii):
        pixels = np.zeros(shape, np.uint8)
        pixels[row[radii == radius], column[radii == radius]] = 1
        disc = np.zeros((2 * radius + 1,) * 2, np.uint8)
        cv2.circle(disc, (int(radius), int(radius)), int(radius), 1, -1)
        drawn |= cv2.dilate(pixels, disc) > 0
    return drawn


def _carve(seen: Items[tuple[Camera, np.ndarray]], grid: VoxelGrid) -> np.ndarray:
    """Return the flat indices (N,) of the voxels that lie in every mask whose picture shows
    them."""
    voxels = np.arange(grid.size)
    for camera, mask in seen:
        inside, row, column, _ = camera.look_up(grid.centres(voxels))
        inside_masks = ~inside
        inside_masks[inside] = mask[row, column]
        voxels = voxels[inside_masks]
    return voxels


def _volume_iou(
    seen: Items[tuple[Camera, np.ndarray]], cloud: VoxelCloud, in_hull: np.ndarray
) -> float:
    """Return the IoU of the voxels in the cloud's surface with the hull (nx, ny, nz) bool, among
    those that all cameras see; NaN if there is nothing to compare."""
    if not seen:
        return float("nan")
    filled = fill_surface(cloud)
    either = np.flatnonzero(filled | in_hull)
    centres = cloud.grid.centres(either)
    visible = either[np.all([camera.look_up(centres)[0] for camera, _ in seen], axis=0)]
    return iou(filled.ravel()[visible], in_hull.ravel()[visible]) if len(visible) else float("nan")


def fill_surface(cloud: VoxelCloud) -> np.ndarray:
    """Return the voxels (nx, ny, nz) bool of the cloud's surface and those that it encloses."""
    shape = cloud.grid.shape
    filled = np.zeros(shape, bool)
    if not len(cloud):
        return filled
    voxels = np.stack(np.unravel_index(cloud.indices, shape))
    box = tuple(
        slice(low, high + 1) for low, high in zip(voxels.min(1), voxels.max(1), strict=True)
    )
    filled.ravel()[cloud.indices] = True
    filled[box] = scipy.ndimage.binary_fill_holes(filled[box])
    return filled
