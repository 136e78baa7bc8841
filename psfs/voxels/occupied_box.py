"""Estimation of the reconstruction volume, if none is stated, from the rig and the first
silhouettes."""

from __future__ import annotations

import cv2
import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import intersect_axes_ahead
from psfs.common.progress import map_in_threads
from psfs.common.regions import find_largest_region_box
from psfs.silhouettes.hidden import UNKNOWN
from psfs.voxels.grid import VoxelGrid

#: Least distance, m, of the cameras from the middle for a rig that films people; edge, m, of a
#: voxel for them, and the greatest number of voxels along the longest side.
_PEOPLE_DISTANCE, PEOPLE_VOXEL, _FINEST = 1.5, 0.02, 400
#: Number of voxels along the longest side for objects.
_FINE = 150
#: Height, m, below which the search ignores everything, for rigs that film people.
FLOOR = -0.1


def default_voxel_size(
    rig: CameraRig, low: np.ndarray, high: np.ndarray, *, objects: bool = False
) -> float:
    """Return the edge of a voxel, m: 2 cm if the cameras are as far away as people need, else 1/150
    of the longest side. objects: no distance counts as that of people."""
    middle = (np.asarray(low) + np.asarray(high)) / 2
    distance = np.median(np.linalg.norm(rig.centres - middle, axis=1))
    longest = float(np.max(np.asarray(high) - low))
    if distance >= _PEOPLE_DISTANCE and not objects:
        return max(PEOPLE_VOXEL, longest / _FINEST)
    return longest / _FINE


def finest_pixel(rig: CameraRig, grid: VoxelGrid) -> float:
    """Return the least width that a pixel of any camera covers in the middle of the grid, m."""
    distances = np.linalg.norm(rig.centres - (grid.low + grid.high) / 2, axis=1)
    focal = [camera.K[[0, 1], [0, 1]].max() for camera in rig]
    return float(np.min(distances / focal))


def reachable_box(rig: CameraRig, floor: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Return a box, m, around the point that the cameras look at, which reaches as far as the
    cameras.

    The point is the nearest one to all optical axes; the box reaches as far as the median camera
    stands from it. With `floor`, the box of a rig large enough for people ends at z = -0.1.
    """
    target = intersect_axes_ahead(rig)
    reach = float(np.median(np.linalg.norm(rig.centres - target, axis=1)))
    low, high = target - reach, target + reach
    if floor and reach >= _PEOPLE_DISTANCE and low[2] < FLOOR < high[2]:
        low[2] = FLOOR
    return low, high


class CoarseSpace:
    """The voxels of a coarse grid that enough cameras see, and the pixels that they fall on.

    used: (N,) their flat indices. pixels: (V, N) int32, flat, -1 outside of a picture. depths: (V,
    N) float32 m. widths: of a voxel in each camera, px.
    """

    def __init__(self, rig: CameraRig, grid: VoxelGrid, min_cameras: int) -> None:
        self.rig, self.grid = rig, grid
        centres = grid.centres()
        pixels = np.full((len(rig), len(centres)), -1, np.int32)
        depths = np.zeros((len(rig), len(centres)), np.float32)

        def see(view: int) -> int:
            camera = rig.cameras[view]
            inside, row, column, depth = camera.look_up(centres)
            pixels[view, inside], depths[view, inside] = row * rig.width + column, depth
            middle = float(np.median(depth)) if len(depth) else 1.0
            return max(1, round(grid.voxel_size * camera.K[0, 0] / middle))

        self.widths = list(map_in_threads(see, range(len(rig))))
        self.used, self.pixels, self.depths = np.arange(len(centres)), pixels, depths
        self.keep((pixels >= 0).sum(0) >= min_cameras)

    def keep(self, chosen: np.ndarray) -> None:
        """Keep the voxels `chosen` (N,) bool alone."""
        self.used = self.used[chosen]
        self.pixels = np.ascontiguousarray(self.pixels[:, chosen])
        self.depths = np.ascontiguousarray(self.depths[:, chosen])

    def cover(self, view: int, rows: np.ndarray, margin: int = 0) -> np.ndarray:
        """Return the pixels (H, W) bool of a camera that the voxels `used[rows]` cover, and those
        within a `margin`, px."""
        shown = np.zeros(self.rig.height * self.rig.width + 1, np.uint8)
        shown[self.pixels[view, rows]] = 1  # the last one is that of voxels outside of the picture
        square = np.ones((self.widths[view] + margin,) * 2, np.uint8)
        return cv2.dilate(shown[:-1].reshape(self.rig.height, self.rig.width), square) > 0

    def carve(self, evidence: np.ndarray, *, all_agree: bool = True) -> np.ndarray:
        """Return the flat indices, ascending, of the occupied voxels: each has the largest evidence
        of the pixels that it covers. evidence: maps (V, H, W) from `remove_speckle`. all_agree: if
        false, where more than three cameras look, the one that denies most does not count:
        furniture may stand before it."""
        wide = [
            _to_evidence(cv2.dilate(_bytes(one), np.ones((width, width), np.uint8)))
            for one, width in zip(evidence, self.widths, strict=True)
        ]
        counts = look_up(np.stack(wide), self.pixels)
        votes = counts.sum(0, dtype=np.int32)
        if not all_agree:
            votes -= np.where((self.pixels >= 0).sum(0) > 3, np.minimum(counts.min(0), 0), 0)
        return self.used[votes > 0]


def look_up(maps: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return the values (V, N) of maps (V, H, W) at flat indices (V, N); 0 at the index -1."""
    padded = np.zeros((len(maps), maps[0].size + 1), maps.dtype)
    padded[:, :-1] = maps.reshape(len(maps), -1)
    values = np.empty(pixels.shape, maps.dtype)
    for own, at, into in zip(padded, pixels, values, strict=True):
        own.take(at, mode="wrap", out=into)
    return values


def largest_parts_box(
    rig: CameraRig, evidence: list[np.ndarray], grid: VoxelGrid, min_cameras: int
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the box, m, around the largest connected parts of all frames, also those that one
    camera denies; None if there are none. evidence: maps of each frame, from `remove_speckle`."""
    space = CoarseSpace(rig, grid, min_cameras)
    boxes = map_in_threads(
        lambda maps: find_largest_region_box(space.carve(maps, all_agree=False), grid.shape),
        evidence,
    )
    corners = np.array([box for box in boxes if box is not None])
    if not len(corners):
        return None
    low, high = corners[:, 0].min(0), corners[:, 1].max(0)
    return grid.origin + low * grid.voxel_size, grid.origin + high * grid.voxel_size


def remove_speckle(evidence: np.ndarray) -> np.ndarray:
    """Return evidence maps (V, H, W) int8 after a 5x5 median; 0 where nothing is known."""
    known = np.where(evidence == UNKNOWN, np.int8(0), evidence)
    return np.stack([_to_evidence(cv2.medianBlur(_bytes(view), 5)) for view in known])


def _bytes(evidence: np.ndarray) -> np.ndarray:
    """Return int8 values as uint8 in the same order, as OpenCV needs them."""
    return evidence.view(np.uint8) ^ np.uint8(128)


def _to_evidence(raised: object) -> np.ndarray:
    return (np.asarray(raised, np.uint8) ^ np.uint8(128)).view(np.int8)
