"""Errors of all particles against the voxels on the device (kernel: likelihood.cl)."""

from __future__ import annotations

import numpy as np

from apf.body import BodyModel
from apf.config import FilterConfig
from apf.kinematics import Kinematics
from cl import Array, Device, Launch
from psfs.camera import CameraRig
from psfs.grid import VoxelGrid
from psfs.reconstruct import Voxels
from psfs.reprojection import Reprojection

_GROUP = 64
#: Place of the grid's position among the arguments of `sample_surface`.
_PLACE = 5


def cone_sampling(body: BodyModel, spacing: float) -> np.ndarray:
    """(C, 2) int32 rows along and columns across each cone, about `spacing` m apart; 0 for those
    that are not looked for in the images."""
    rows = [np.linalg.norm(cone.end - cone.start) / spacing for cone in body.cones]
    columns = [np.mean(cone.radii) * 2 / spacing for cone in body.cones]
    sampling = np.maximum(np.ceil(np.stack([rows, columns], -1)), (4, 3)).astype(np.int32)
    sampling[[not cone.in_images for cone in body.cones]] = 0
    return sampling


class VoxelLikelihood:
    """A `Scorer` of poses of `body` by the voxels of `grid`: by their reprojection into the
    cameras of `rig`, and by the surface voxels themselves.

    `errors` is Song et al. eq. (16) with the sign put right, and more terms (see `FilterConfig`).
    """

    def __init__(
        self,
        device: Device,
        body: BodyModel,
        rig: CameraRig,
        grid: VoxelGrid,
        config: FilterConfig,
    ) -> None:
        self.device = device
        self.rig = rig
        self.config = config
        self._grid: VoxelGrid | None = None
        self._voxels: Voxels | None = None
        self._reprojection = Reprojection(device, rig, grid)
        self._kinematics = Kinematics(device, body, config.n_particles)
        self.n_cones = len(body.cones)
        n, v = config.n_particles, len(rig)
        sampling = cone_sampling(body, config.sample_spacing)
        self._sampling = device.to_device(sampling, "the cones' samples")
        self._n_pairs = len(body.apart)
        pairs = np.array(body.apart or [(0, 0)], np.int32)
        self._pairs = device.to_device(pairs, "the parts that stay apart")
        self._cameras = device.to_device(rig.packed(), "the cameras")
        self._sums = device.empty((v, n, self.n_cones, 4), np.float32, "the image errors")
        self.points = device.empty((config.n_points, 4), np.float32, "the surface samples")
        self._surface_errors = device.zeros((n,), np.float32, "the surface errors")
        self.errors = device.empty((n,), np.float32, "the errors")

    def observe(self, voxels: Voxels) -> None:
        """Enqueue the maps of `voxels` and the choice of the surface voxels to look at."""
        self._reprojection(voxels)
        if voxels is not self._voxels:
            self._voxels, self._grid = voxels, None
            self._sample_surface = self._surface_launch(voxels)
        if voxels.grid is not self._grid:
            self._grid = voxels.grid
            place = np.array([*voxels.grid.origin, voxels.grid.voxel_size], np.float32)
            self._sample_surface.set_arg(_PLACE, place)
        self._sample_surface()

    def launcher(self, poses: Array) -> list[Launch]:
        """The launches that score `poses` (N, D) float32 into `errors`, arguments set."""
        cones = self._kinematics.cones
        return [*self._kinematics.launcher(poses), *self._launches(cones, self._reprojection.maps)]

    def _surface_launch(self, voxels: Voxels) -> Launch:
        return self.device.launch(
            self._kernel("sample_surface"),
            (self.config.n_points,),
            (_GROUP,),
            np.int32(self.config.n_points),
            voxels.count,
            voxels.surface,
            np.int32(voxels.grid.shape[1]),
            np.int32(voxels.grid.shape[2]),
            np.zeros(4, np.float32),
            self.points,
        )

    def _launches(self, cones: Array, maps: Array) -> list[Launch]:
        """Score `cones` (N, C, 16) against `maps` (V, H, W, 2) uint8."""
        n, v = np.int32(self.config.n_particles), np.int32(len(self.rig))
        launches = [
            self.device.launch(
                self._kernel("score_images"),
                (int(n) * self.n_cones, int(v)),
                (_GROUP, 1),
                n,
                np.int32(self.rig.width),
                np.int32(self.rig.height),
                cones,
                self._cameras,
                maps,
                self._sampling,
                self._sums,
            ),
            self.device.launch(
                self._kernel("score_surface"),
                (int(n) * _GROUP,),
                (_GROUP,),
                np.int32(self.config.n_points),
                np.float32(self.config.surface_scale),
                self.points,
                cones,
                self._surface_errors,
            ),
            self.device.launch(
                self._kernel("total_errors"),
                (int(n),),
                (_GROUP,),
                n,
                v,
                np.int32(self._n_pairs),
                self.config.weights,
                cones,
                self._pairs,
                self._sums,
                self._surface_errors,
                self.errors,
            ),
        ]
        if self.config.surface_weight == 0:
            del launches[1]
        return launches

    def _kernel(self, name: str) -> object:
        return self.device.kernel("likelihood", name, N_CONES=self.n_cones, GROUP=_GROUP)
