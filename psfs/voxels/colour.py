"""Colours of the surface voxels on an OpenCL device (Song et al. 3.3)."""

from __future__ import annotations

import numpy as np

from cl import Array, Device
from cl.signature import Argument
from cl.workgroups import size_defines
from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import voxel_footprints
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.surface import SurfaceList

#: Bits of the float infinity, a depth that no voxel has. Depths are positive, so the order of their
#: bits is that of their values.
_FAR = int(np.float32(np.inf).view(np.int32))
#: Distance, voxels, behind the nearest voxel up to which a voxel is visible: more than the diagonal
#: of a voxel's face, 1.41, less than that of the cube, 1.73.
TOLERANCE = 1.5


class SurfaceColour:
    """Computation of the surface voxels' colours (capacity, 4) uint8: RGB, and the number of
    cameras in the mean.

    All surface voxels are projected into a z-buffer per camera, each as the bounding box of its
    cube. A camera sees a voxel within `TOLERANCE` voxels of the buffer's depth. The colour
    is the mean over the cameras that see the voxel within the person's silhouette; without such a
    camera, over all that see it; if none does, it comes from the camera with the least depth
    between voxel and buffer.
    """

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        grid: VoxelGrid,
        surface: SurfaceList,
        evidence: Array,
    ) -> None:
        self._grid: VoxelGrid | None = None
        views, height, width = len(rig), rig.height, rig.width
        self.colours = device.empty((surface.capacity, 4), np.uint8, "the surface's colours")
        self._depths = device.empty((views, height, width), np.uint32, "the z-buffers")
        self._geometry = device.empty(4, np.float32, "the grid's position")
        cameras = device.to_device(rig.packed(), "the cameras")
        extents = voxel_footprints(rig, grid.voxel_size).astype(np.float32)
        sizes = size_defines(device, rig.picture, grid.shape)
        nearest_depth, surface_colour = (
            device.kernel(
                "reconstruction/colour", name, **rig.defines, **sizes, TOLERANCE=TOLERANCE
            )
            for name in ("nearest_depth", "surface_colour")
        )
        voxels: dict[str, Argument] = {
            "picture": rig.picture,
            "grid": grid.shape,
            "cameras": cameras,
            "geometry": self._geometry,
            "indices": surface.indices,
            "n_surface": surface.count,
            "depths": self._depths,
        }
        self._splat = device.launch(
            nearest_depth,
            (16384 if device.is_gpu else 512, views),
            (64, 1),
            **voxels,
            extents=device.to_device(extents, "the footprints"),
        )
        self._colour = device.launch(
            surface_colour,
            (32768 if device.is_gpu else 512,),
            (64,),
            n_views=views,
            **voxels,
            images=None,  # set for every frame
            evidence=evidence,
            colours=self.colours,
        )

    def __call__(self, grid: VoxelGrid, images: Array) -> Array:
        """Enqueue the colours of the surface in `grid`; images: (V, H, W, 3) uint8 BGR."""
        if grid is not self._grid:
            self._grid = grid
            self._geometry.set(np.array([*grid.origin, grid.voxel_size], np.float32))
        self._colour.set(images=images)
        self._depths.fill(_FAR)
        self._splat()
        self._colour()
        return self.colours
