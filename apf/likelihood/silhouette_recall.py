"""Share of the silhouettes that the body covers (kernels: silhouette_recall.cl)."""

from __future__ import annotations

import numpy as np

from apf.body.posing import CONE_DEFINES
from apf.likelihood.base import PointSubset
from apf.scene import Scene
from cl import Array, Kernel, Launch
from cl.workgroups import WIDE_GROUP, pack_defines
from psfs.common.cones import CONE_FLOATS
from psfs.voxels.device_voxels import CarvedVoxels

#: Most cameras that a GPU's work-group looks at together: local memory holds their cones' edges.
_VIEWS = 8


class SilhouetteRecall:
    """Term for 1 - recall of the silhouettes: the share of the surface samples `points` (K, 4) that
    no part of a pose covers in the pictures.

    Song et al. eq. (15) only measures whether the body lies within the silhouettes, so that both
    legs can lie in the silhouette of one. This term measures the reverse, as Rymut 2016 eq. (4.42).
    `points`, `pixels`: two arrays (K, 4) and (V, K, 2) each; `sampling_launch` writes the first and
    the launches read the second. Twin: reference/likelihood/voxel.py.
    """

    def __init__(
        self,
        scene: Scene,
        cameras: Array,
        points: tuple[Array, Array],
        pixels: tuple[Array, Array],
    ) -> None:
        device, body, rig = scene.opencl, scene.body, scene.rig
        self.device = device
        self._n_views, self._n_points = len(rig), points[0].shape[0]
        self._cameras, self._points, self._pixels = cameras, points, pixels
        self._defines = pack_defines(device, WIDE_GROUP) | {"N_CONES": len(body.cones)}
        together = min(_VIEWS, 1 << (len(rig) - 1).bit_length())
        self._defines |= rig.defines
        self._defines["VIEWS"] = min(together, self._defines["GROUP"])
        self._cones: dict[int, Array] = {}  # by number of poses: launches share buffers

    def sampling_launch(self, voxels: CarvedVoxels) -> Launch:
        """Return the launch that samples the surface of a frame; its argument `origin_size` is to
        be set."""
        return self.device.launch(
            self._kernel("sample_surface"),
            (-(-self._n_points // self._defines["PACK"]),),
            (64,),
            n_points=self._n_points,
            n_views=self._n_views,
            count=voxels.count,
            surface=voxels.surface,
            ny=voxels.grid.shape[1],
            nz=voxels.grid.shape[2],
            origin_size=(0.0, 0.0, 0.0, 0.0),
            cameras=self._cameras,
            points=self._points[0],
            pixels=self._pixels[0],
        )

    def cone_buffer(self, n: int) -> Array:
        """Return the buffer for the posed cones (n, C, CONE_FLOATS) of `n` poses."""
        if n not in self._cones:
            shape = (n, self._defines["N_CONES"], CONE_FLOATS)
            self._cones[n] = self.device.empty(shape, np.float32, "the posed cones")
        return self._cones[n]

    def launch(self, subset: PointSubset, weight: float, errors: Array) -> Launch:
        """Return the launch that adds the term to `errors` (n,): `weight` times the uncovered share
        of the samples in `subset`, once per camera.

        The posed cones must be in `cone_buffer(n)`."""
        n = errors.size
        return self.device.launch(
            self._kernel("add_uncovered"),
            (n * self._defines["GROUP"],),
            (self._defines["GROUP"],),
            n_points=self._n_points,
            first_point=subset.first,
            stride=subset.stride,
            n_views=self._n_views,
            weight=weight,
            cones=self.cone_buffer(n),
            cameras=self._cameras,
            pixels=self._pixels[1],
            errors=errors,
        )

    def _kernel(self, name: str) -> Kernel:
        return self.device.kernel(
            "tracking/silhouette_recall", name, **self._defines, **CONE_DEFINES
        )
