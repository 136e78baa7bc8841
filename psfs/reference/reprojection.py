"""Reprojection of voxels, hidden pixels and distances to edges in NumPy. Twin of reprojection.cl,
hidden.cl and distance.h."""

from __future__ import annotations

import numpy as np
import scipy

from cl import Device, NumpyDevice
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.rig_geometry import pixel_boxes, voxel_footprints
from psfs.silhouettes.hidden import UNKNOWN
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.host_voxels import HostVoxels
from psfs.voxels.reprojection import BELOW, LEAST_PIXELS, MARK, SIDES, edge_reach, proximity_table


def splat(
    camera: Camera, centres: np.ndarray, footprint: np.ndarray, shape: tuple[int, int]
) -> np.ndarray:
    """Return the silhouette `shape` bool of voxels with `centres` (N, 3): the union of the boxes
    of pixels that they cover; see `voxel_footprints`."""
    low, end, _ = pixel_boxes(camera, centres, footprint)
    covered = np.zeros(shape, bool)
    for x0, y0, x1, y1 in np.unique(np.column_stack([low, end]), axis=0):
        covered[y0:y1, x0:x1] = True
    return covered


def boundary(silhouette: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return the pixels inside with a 4-neighbour outside; the picture's border is no boundary."""
    width, height = size
    picture = silhouette[:height, :width]
    inside = scipy.ndimage.binary_erosion(picture, border_value=1)
    edge = np.zeros_like(silhouette)
    edge[:height, :width] = picture & ~inside
    return edge


def join_foreground(silhouette: np.ndarray, evidence: np.ndarray) -> np.ndarray:
    """Return `silhouette` (H, W) bool with the foreground of `evidence` (H, W) int8 beside it.

    Twin of foreground_join.cl. The computation works in cells of MARK x MARK pixels: the box of the
    cells that the silhouette touches, made larger by `SIDES` and `BELOW`; in the box,
    all foreground pixels of those cells that have at least `LEAST_PIXELS` together with
    their eight neighbours in the box.
    """
    height, width = silhouette.shape
    rows, columns = -(-height // MARK), -(-width // MARK)
    padding = ((0, rows * MARK - height), (0, columns * MARK - width))

    def cells(pixels: np.ndarray) -> np.ndarray:
        """Count the pixels set in each cell."""
        padded = np.pad(pixels, padding).reshape(rows, MARK, columns, MARK)
        return padded.sum((1, 3))

    y, x = np.nonzero(cells(silhouette))
    if not len(y):
        return silhouette
    tall = y.max() + 1 - y.min()
    sides, below = SIDES * tall // 100, BELOW * tall // 100
    box = np.zeros((rows, columns), bool)
    above, left = max(y.min() - sides, 0), max(x.min() - sides, 0)
    box[above : y.max() + 1 + below, left : x.max() + 1 + sides] = True
    shown = evidence > 0
    counts = np.where(box, cells(shown), 0)
    near = scipy.ndimage.convolve(counts, np.ones((3, 3), int), mode="constant")
    taken = box & (near >= LEAST_PIXELS)
    pixels = taken.repeat(MARK, 0).repeat(MARK, 1)[:height, :width]
    return silhouette | (shown & pixels)


class NumpyReprojection:
    """The same signature and results as `Reprojection`; the maps are a NumPy array."""

    def __init__(
        self,
        device: Device | NumpyDevice,
        rig: CameraRig,
        grid: VoxelGrid,
        *,
        join: bool = False,
    ) -> None:
        self._join = join
        self.rig = rig
        self._proximity = proximity_table(*edge_reach(rig))

    def __call__(self, voxels: HostVoxels) -> np.ndarray:
        shape = (self.rig.height, self.rig.width)
        centres = voxels.grid.centres(voxels.surface)
        maps = np.zeros((len(self.rig), *shape, 2), np.uint8)
        extents = voxel_footprints(self.rig, voxels.grid.voxel_size)
        for view, camera in enumerate(self.rig):
            silhouette = splat(camera, centres, extents[view], shape)
            if self._join and voxels.evidence is not None:
                silhouette = join_foreground(silhouette, voxels.evidence[view])
            edge = boundary(silhouette, camera.size)
            maps[view, ..., 0] = np.where(silhouette, 255, 0)
            maps[view, ..., 1] = proximity(edge, self._proximity)
        if self.rig.hidden is not None and voxels.evidence is not None:
            mark_hidden(maps, voxels.evidence)
        return maps


def hide(evidence: np.ndarray, hidden: np.ndarray | None) -> np.ndarray:
    """Return evidence (V, H, W) int8, `UNKNOWN` at hidden pixels (V, H, W) where it is not above
    0."""
    if hidden is None:
        return evidence
    return np.where(hidden & (evidence <= 0), np.int8(UNKNOWN), evidence)


def mark_hidden(maps: np.ndarray, evidence: np.ndarray) -> None:
    """Flip the lowest bit of the silhouettes, the first channel of maps (V, H, W, 2) uint8, where
    the evidence (V, H, W) int8 is `UNKNOWN`."""
    maps[..., 0] ^= (evidence == UNKNOWN).view(np.uint8)


def proximity(edges: np.ndarray, table: np.ndarray, metric: str = "euclidean") -> np.ndarray:
    """Return (h, w) uint8: the entry of `table` (reach^2 + 2,) at the squared distance, px^2, to
    the nearest of `edges` (h, w) bool; the last entry beyond reach. metric: "euclidean", or
    "chessboard" for the greater of |dx| and |dy|."""
    if not edges.any():
        return np.full(edges.shape, table[-1])
    if metric == "chessboard":
        squared = scipy.ndimage.distance_transform_cdt(~edges, "chessboard").astype(int) ** 2
    else:
        squared = np.rint(scipy.ndimage.distance_transform_edt(~edges) ** 2).astype(int)
    return table[np.minimum(squared, len(table) - 1)]
