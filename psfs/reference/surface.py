"""Occupancy, surface and colours of voxels. Twin of occupancy.cl, surface.cl and colour.cl."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.rig_geometry import pixel_boxes, voxel_footprints
from psfs.silhouettes.hidden import HIDDEN, UNKNOWN
from psfs.voxels.colour import TOLERANCE
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelGrid


def smooth(padded: np.ndarray, faces: bool = False) -> np.ndarray:
    """Return the mean over 3x3x3 voxels, or over each and its six neighbours if `faces`: (nx + 2,
    ny + 2, nz + 2) -> (nx, ny, nz)."""
    nx, ny, nz = (n - 2 for n in padded.shape)
    total = np.zeros((nx, ny, nz))
    for dx, dy, dz in np.ndindex(3, 3, 3):
        if not faces or abs(dx - 1) + abs(dy - 1) + abs(dz - 1) <= 1:
            total += padded[dx : dx + nx, dy : dy + ny, dz : dz + nz]
    return total / (7 if faces else 27)


def surface_voxels(occupied: np.ndarray, closed: bool = False) -> np.ndarray:
    """Return the flat indices (N,) int32, ascending, of occupied voxels with an empty neighbour,
    one of 26 if `closed`, else of 6.

    Voxels outside the grid count as empty.
    """
    padded = np.pad(occupied, 1)
    inside = occupied.copy()
    for shift in np.ndindex(3, 3, 3):
        offset = np.array(shift) - 1
        if closed or np.abs(offset).sum() == 1:
            inside &= np.roll(padded, tuple(offset), (0, 1, 2))[1:-1, 1:-1, 1:-1]
    return np.flatnonzero(occupied & ~inside).astype(np.int32)


def mean_position(
    surface: np.ndarray, shape: tuple[int, int, int], samples: int
) -> np.ndarray | None:
    """Return the mean position (3,) of the surface voxels, flat indices (N,), in voxels from the
    grid's corner; None if there are none. If there are more than `samples`, that many are taken
    evenly from the list.
    """
    if not len(surface):
        return None
    n = min(len(surface), samples)
    picked = surface[np.arange(n) * len(surface) // n]
    return (np.stack(np.unravel_index(picked, shape), -1) + 0.5).mean(0)


#: Counts (N,) that a tracked body adds to voxels at points (N, 3) m.
BodyEvidence = Callable[[np.ndarray], np.ndarray]


def padded_grid(grid: VoxelGrid) -> VoxelGrid:
    """Return `grid` with one more layer of voxels on every side."""
    shape = (grid.shape[0] + 2, grid.shape[1] + 2, grid.shape[2] + 2)
    return VoxelGrid(grid.origin - grid.voxel_size, grid.voxel_size, shape)


def blur(evidence: np.ndarray, reach: int) -> np.ndarray:
    """Return evidence (V, H, W) int8 that is at each pixel the largest within `reach` + 1/2 px;
    where it is unknown it stays so, unless there is foreground."""
    if not reach:
        return evidence
    along = np.arange(-reach, reach + 1)
    disc = along**2 + along[:, None] ** 2 <= reach * (reach + 1)
    most = scipy.ndimage.grey_dilation(evidence, footprint=disc[None], mode="nearest")
    return np.where((evidence == UNKNOWN) & (most <= 0), evidence, most)


def occupancy(
    rig: CameraRig,
    grid: VoxelGrid,
    evidence: np.ndarray,
    step: float,
    config: OccupancyConfig,
    *,
    body: BodyEvidence | None = None,
) -> np.ndarray:
    """Return P(V = 1) of the padded grid (nx + 2, ny + 2, nz + 2) by evidence counts (V, H, W).

    A camera from which something hides a voxel (`UNKNOWN`) adds `HIDDEN`. body: the counts (N,)
    that a tracked body adds to voxels at points (N, 3); the sum is limited as the table is.
    """
    evidence = blur(evidence, config.reach_px(rig.blur))
    padded = padded_grid(grid)
    centres = padded.centres()
    total = np.zeros(len(centres))
    seeing = np.zeros(len(centres), int)
    for camera, counts in zip(rig, evidence, strict=True):
        inside, row, column, _ = camera.look_up(centres)
        seen = counts[row, column]
        total[inside] += np.where(seen == UNKNOWN, HIDDEN, seen)
        seeing += inside
    if body is not None:
        total = np.clip(total + body(centres), -127 * len(rig), 127 * len(rig))
    log_odds = np.log(config.prior / (1 - config.prior)) + total * step
    probability = np.where(
        seeing >= config.seeing_cameras(len(rig)), 1 / (1 + np.exp(-log_odds)), 0.0
    )
    return probability.reshape(padded.shape)


def nearest_depth(
    camera: Camera, centres: np.ndarray, footprint: np.ndarray, shape: tuple[int, int]
) -> np.ndarray:
    """Return (H, W) depth in m of the nearest voxel, infinite where there is none; see
    `voxel_footprints`."""
    low, high, depth = pixel_boxes(camera, centres, footprint)
    extent = high - low
    buffer = np.full(shape, np.inf)
    for dx, dy in np.ndindex(*extent.max(0, initial=0)):
        covers = (extent > (dx, dy)).all(1)
        column, row = low[covers].T
        np.minimum.at(buffer, (row + dy, column + dx), depth[covers])
    return buffer


def surface_colour(
    rig: CameraRig,
    grid: VoxelGrid,
    surface: np.ndarray,
    images: np.ndarray,
    evidence: np.ndarray,
) -> np.ndarray:
    """Return (N, 4) uint8 RGB of the voxels with flat indices `surface`, and the number of cameras
    in the mean; images (V, H, W, 3) BGR. See `psfs.voxels.colour.SurfaceColour`."""
    centres = grid.centres(surface)
    sums = np.zeros((2, len(centres), 3), int)  # seen within the silhouette, seen at all
    numbers = np.zeros((2, len(centres)), int)
    least, least_colour = np.full(len(centres), np.inf), np.zeros((len(centres), 3), int)
    extents = voxel_footprints(rig, grid.voxel_size)
    for view, camera in enumerate(rig):
        buffer = nearest_depth(camera, centres, extents[view], images.shape[1:3])
        inside, row, column, depth = camera.look_up(centres)
        voxels, rgb = np.flatnonzero(inside), images[view, row, column, ::-1].astype(int)
        behind = depth - buffer[row, column]
        seen = behind <= TOLERANCE * grid.voxel_size
        for kind, counts in enumerate((seen & (evidence[view, row, column] > 0), seen)):
            sums[kind][voxels[counts]] += rgb[counts]
            numbers[kind][voxels[counts]] += 1
        nearer = ~seen & (behind < least[voxels])
        least[voxels[nearer]], least_colour[voxels[nearer]] = behind[nearer], rgb[nearer]
    chosen = np.where(numbers[0] > 0, 0, 1), np.arange(len(centres))
    number, total = numbers[chosen], sums[chosen]
    shared = np.maximum(number, 1)[:, None]
    mean = np.where(number[:, None] > 0, (total + shared // 2) // shared, least_colour)
    return np.concatenate([mean, number[:, None]], 1).astype(np.uint8)
