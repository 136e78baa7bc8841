"""Silhouettes and edges of the reconstructed voxels in every camera (Song et al. 2.3.2)."""

from __future__ import annotations

import numpy as np

from cl import Array, Device, InputError, Kernel, Launch
from cl.workgroups import GROUP, row_group, size_defines
from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import voxel_footprints
from psfs.common.edge_distance import LOT, count_tiles, distance_defines
from psfs.silhouettes.hidden import UNKNOWN
from psfs.voxels.device_voxels import CarvedVoxels
from psfs.voxels.grid import VoxelGrid

#: Edge of a cell, px: the silhouettes are marked per cell, and a cell's 64 pixels are the bits of a
#: word.
MARK = 8
#: Enlargement of the box around the silhouette, as a share of its height, %: at both sides and
#: above, as far as a missing arm reaches; below, less, because of shadows.
SIDES, BELOW = 35, 5
#: Least number of foreground pixels among 24 x 24 that do not count as speckle.
LEAST_PIXELS = 40


class ForegroundJoin:
    """`join(evidence)`: addition of foreground in the evidence maps (V, H, W) int8 to the
    silhouettes.

    Foreground counts in and around the box of each silhouette in `silhouette`, which `Reprojection`
    holds.

    A single camera that takes a voxel for background carves it away, so an arm before a wall of its
    colour is missing from the voxels and thereby from all reprojected silhouettes. Most cameras'
    evidence still shows it. Kernel: foreground_join.cl; twin: reference/reprojection.py.
    """

    def __init__(self, device: Device, rig: CameraRig, silhouette: Array) -> None:
        self.device, self._views, self._picture = device, len(rig), rig.picture
        self._n_cells = -(-rig.width // MARK) * -(-rig.height // MARK)
        self._defines = {
            **size_defines(device, rig.picture),
            "MARK": MARK,
            "GROUP": GROUP if device.is_gpu else 1,
        }
        self._silhouette = silhouette.view(np.uint8)
        self._boxes = device.empty((len(rig), 4), np.int32, "the persons' boxes")
        shape = (len(rig), self._n_cells)
        self._bits = device.empty(shape, np.uint64, "the foreground's cells")
        group = self._defines["GROUP"]
        self._box = device.launch(
            self._kernel("person_box"),
            (group, len(rig)),
            (group, 1),
            picture=self._picture,
            sides=SIDES,
            below=BELOW,
            silhouette=self._silhouette,
            boxes=self._boxes,
        )
        self._join = device.launch(
            self._kernel("join_foreground"),
            *self._size(),
            picture=self._picture,
            least=LEAST_PIXELS,
            boxes=self._boxes,
            bits=self._bits,
            silhouette=self._silhouette,
        )
        self._evidence: Array | None = None

    def __call__(self, evidence: Array) -> None:
        """Enqueue the join of `evidence` (V, H, W) int8, above 0 where foreground is likelier."""
        if evidence is not self._evidence:
            self._evidence = evidence
            self._take = self._bits_launch(evidence)
        self._box()
        self._take()
        self._join()

    def _bits_launch(self, evidence: Array) -> Launch:
        return self.device.launch(
            self._kernel("foreground_bits"),
            *self._size(),
            picture=self._picture,
            evidence=evidence,
            boxes=self._boxes,
            bits=self._bits,
        )

    def _size(self) -> tuple[tuple[int, int], tuple[int, int]]:
        local = row_group(self.device)[0]
        return (self._n_cells, self._views), (local, 1)

    def _kernel(self, name: str) -> Kernel:
        return self.device.kernel("reconstruction/foreground_join", name, **self._defines)


#: Standard deviation of the edges' proximity in maps 640 px wide, px; in others it scales.
_SIGMA = 4.0


class Reprojection:
    """Computation of maps (V, H, W, 2) uint8 of the voxels on the device; the next call overwrites
    them.

    Channel 0: silhouette of the voxels, 0 or 255; 1 or 254 at the frame's hidden pixels: these
    differ little as silhouettes, and show terms that read the pictures, too, that something else is
    visible there. Channel 1: proximity to its boundary, round(255 exp(-d^2 / (2 sigma^2)))
    with d the Euclidean distance in pixels to the nearest boundary pixel, 0 beyond a radius; see
    `edge_reach`. With `join`, the silhouettes also contain the foreground beside them in the
    frame's evidence maps, if it has any, see `ForegroundJoin`. `maps` are created unless given.
    """

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        grid: VoxelGrid,
        *,
        join: bool = False,
        maps: Array | None = None,
    ) -> None:
        self.device, self.rig = device, rig
        sigma, radius = edge_reach(rig)
        self._grid: VoxelGrid | None = None
        self._shape = grid.shape
        self._voxels: CarvedVoxels | None = None
        views, height, width = len(self.rig), self.rig.height, self.rig.width
        if maps is None:
            maps = device.empty((views, height, width, 2), np.uint8, "the reprojected maps")
        self.maps = maps
        # One extra row before and after the picture, then the marks; all are cleared as words. CPUs
        # read several pixels at once.
        marks = -(-height // MARK) * -(-width // MARK)
        nbytes = (views * height + 2) * width + views * marks + LOT
        self._silhouette = device.empty((-(-nbytes // 4),), np.uint32, "the silhouettes")
        self._geometry = device.empty(4, np.float32, "the grid's position")
        self._cameras = device.to_device(self.rig.packed(), "the cameras")
        sizes = device.to_device(np.array([c.size for c in self.rig], np.int32), "picture sizes")
        table = device.to_device(proximity_table(sigma, radius), "the proximity table")
        self._defines = distance_defines(device, radius)
        self._defines |= {**self.rig.defines, "MARK": MARK, "UNKNOWN": UNKNOWN}
        self._defines |= size_defines(device, self.rig.picture, grid.shape)
        self._join: ForegroundJoin | None = None
        if join:
            self._join = ForegroundJoin(device, rig, self._silhouette)
        group = self._defines["GROUP"]
        self._edges = device.launch(
            device.kernel("reconstruction/reprojection", "edge_proximity", **self._defines),
            (count_tiles(self._defines, self.rig.picture) * group, views),
            (group, 1),
            picture=self.rig.picture,
            reach=radius,
            silhouette=self._silhouette.view(np.uint8),
            sizes=sizes,
            proximity=table,
            evidence=None,
            maps=self.maps,
        )

    def __call__(self, voxels: CarvedVoxels) -> Array:
        """Enqueue the computation of the maps of `voxels`. Raises InputError if their grid has
        another shape."""
        if voxels is not self._voxels:
            self._attach(voxels)
        if voxels.grid is not self._grid:
            self._grid = voxels.grid
            geometry = np.array([*voxels.grid.origin, voxels.grid.voxel_size], np.float32)
            self._geometry.set(geometry)
            self._extents.set(voxel_footprints(self.rig, voxels.grid.voxel_size).astype(np.float32))
        self._silhouette.fill(0)
        self._splat()
        if self._join is not None and voxels.evidence is not None:
            self._join(voxels.evidence)
        self._edges()
        return self.maps

    def _attach(self, voxels: CarvedVoxels) -> None:
        """Connect the splatting kernel to the buffers of `voxels`."""
        if voxels.grid.shape != self._shape:
            raise InputError(f"the voxels' grid is {voxels.grid.shape}; expected {self._shape}")
        self._voxels = voxels
        self._extents = self.device.empty((len(self.rig), 2), np.float32, "the footprints")
        self._splat = self.device.launch(
            self.device.kernel("reconstruction/reprojection", "splat", **self._defines),
            (16384 if self.device.is_gpu else 512, len(self.rig)),
            (64, 1),
            picture=self.rig.picture,
            grid=voxels.grid.shape,
            cameras=self._cameras,
            extents=self._extents,
            geometry=self._geometry,
            indices=voxels.surface,
            n_surface=voxels.count,
            silhouette=self._silhouette.view(np.uint8),
        )
        self._edges.set(evidence=voxels.evidence if self.rig.hidden is not None else None)
        self._grid = None


def edge_reach(rig: CameraRig) -> tuple[float, int]:
    """Return sigma and the radius of the edges' proximity, px. Raises InputError for a radius
    beyond the kernel's.

    The proximity ends at the usual 3 sigma."""
    sigma = _SIGMA * rig.width / 640
    radius = max(1, round(3 * sigma))
    if not 1 <= radius <= 127:
        raise InputError(f"the edge radius is {radius} px; expected 1 to 127")
    return sigma, radius


def proximity_table(sigma: float, radius: int) -> np.ndarray:
    """Return (radius^2 + 2,) uint8: proximity by squared distance, px^2; the last entry is for all
    greater distances."""
    squared = np.arange(radius**2 + 2)
    table = np.rint(255 * np.exp(-squared / (2 * sigma**2))).astype(np.uint8)
    table[-1] = 0
    return table
