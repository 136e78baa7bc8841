"""Errors of all particles against the voxels on the device (kernel: likelihood.cl)."""

from __future__ import annotations

from typing import Any

import numpy as np

from apf.body.kinematics import CONE_FLOATS
from apf.body.model import BodyModel
from apf.body.posing import CONE_DEFINES, FRAME_FLOATS, SPAN_FLOATS, body_defines, pack_body
from apf.filters.config import FilterConfig
from apf.likelihood.base import Likelihood
from apf.likelihood.motion_prior import Smoothness
from apf.likelihood.part_colour import LimbColours
from apf.likelihood.silhouette_recall import Coverage
from apf.scene import Scene
from cl import Array, InputError, Launch
from cl.workgroups import pack_defines, pack_size
from psfs.cameras.camera import CAMERA_FLOATS
from psfs.voxels.device_voxels import Voxels
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.reprojection import Reprojection

_GROUP = 256
#: Floats of a cone's outline in a picture: x and y of its corners.
_OUTLINE_FLOATS = 8


def cone_sampling(body: BodyModel, spacing: float) -> np.ndarray:
    """(C, 2) int32 rows along and columns across each cone, about `spacing` m apart; 0 for those
    that are not looked for in the images."""
    rows = [np.linalg.norm(cone.end - cone.start) / spacing for cone in body.cones]
    columns = [np.mean(cone.radii) * 2 / spacing for cone in body.cones]
    sampling = np.maximum(np.ceil(np.stack([rows, columns], -1)), (4, 3)).astype(np.int32)
    sampling[[not cone.in_images for cone in body.cones]] = 0
    return sampling


def sample_rows(sampling: np.ndarray) -> np.ndarray:
    """(R, 4) float32 for rows, columns (C, 2) of every cone: cone, place of the row along it, n
    columns, 1 / n. The longest first: rows that are worked on together are about as long."""
    rows = [
        (cone, (row + 0.5) / n_rows, n_columns, 1 / n_columns)
        for cone, (n_rows, n_columns) in enumerate(sampling)
        for row in range(n_rows)
    ]
    rows.sort(key=lambda row: -row[2])
    return np.array(rows, np.float32).reshape(-1, 4)


class VoxelLikelihood(Likelihood):
    """Scores poses of a scene's body by its voxels: by their reprojection into the
    cameras, and by the surface voxels themselves.

    `errors` is Song et al. eq. (16) with the sign put right, and more terms (see `FilterConfig`).
    Those of `n_runs` trackings have room in it and, one each, in `misfits`. Raises InputError for
    several with terms that depend on the track so far.
    """

    points: Array
    misfits: Array

    def __init__(self, scene: Scene, config: FilterConfig, n_runs: int = 1) -> None:
        if n_runs > 1 and config.remembers:
            raise InputError(
                f"{n_runs} runs at once: the likelihood's terms colour and smoothness depend on "
                "the track so far; expected neither"
            )
        device, body, rig = scene.opencl, scene.body, scene.rig
        self.device, self.rig, self.config = device, rig, config
        self._grid: VoxelGrid | None = None
        self._voxels: Voxels | None = None
        self._reprojection = Reprojection(device, rig, scene.voxel_grid)
        self._body = device.to_device(pack_body(body), "the body model")
        rows = sample_rows(cone_sampling(body, config.sample_spacing))
        self._rows = device.to_device(rows, "the cones' samples")
        self._defines = self._fitting_defines(body)
        self._n_pairs = len(body.apart)
        pairs = np.array(body.apart or [(0, 0)], np.int32)
        self._pairs = device.to_device(pairs, "the parts that stay apart")
        habits = np.stack([body.rest_pose, 1 / body.posture_sigma], -1)
        self._habits = device.to_device(habits.astype(np.float32))
        self._cameras = device.to_device(rig.packed(), "the cameras")
        self._n_launchers = 0
        self.points = device.empty((config.n_points, 4), np.float32, "the surface samples")
        self.errors = device.empty((n_runs * config.n_particles,), np.float32, "the errors")
        self.misfits = device.zeros((n_runs,), np.float32)
        self._coverage: Coverage | None = None
        if config.settling_two_sided > 0:
            self._coverage = Coverage(scene, self._cameras, self.points)
        self._colours: LimbColours | None = None
        if config.colour_weight > 0:
            self._colours = LimbColours(device, body, self._body, self.points, config)
        self._smoothness: Smoothness | None = None
        if config.smoothness_weight > 0:
            self._smoothness = Smoothness(device, body, config)

    def forget(self) -> None:
        """A new track begins: no colour is known, no pose expected."""
        for term in (self._colours, self._smoothness):
            if term is not None:
                term.forget()

    def learning_launcher(self, pose: Array) -> list[Launch]:
        """The launches that end a frame: its estimate is the first of `pose` (.., D)."""
        terms = (self._colours, self._smoothness)
        return [
            launch for term in terms if term is not None for launch in term.learning_launcher(pose)
        ]

    def observe(self, voxels: Voxels) -> None:
        """Enqueue the maps of `voxels` and the choice of the surface voxels to look at."""
        self._reprojection(voxels)
        if voxels is not self._voxels:
            self._voxels, self._grid = voxels, None
            self._sample_surface = self._surface_launch(voxels)
        if voxels.grid is not self._grid:
            self._grid = voxels.grid
            position = [*voxels.grid.origin, voxels.grid.voxel_size]
            self._sample_surface.set(origin_size=position)
        self._sample_surface()
        if self._coverage is not None:
            self._coverage.observe()
        if self._colours is not None:
            self._colours.observe(voxels)

    def launcher(self, poses: Array) -> list[Launch]:
        """The launches that score `poses` (N, D) float32 into `errors`, arguments set.

        Every launcher looks at another share of the surface samples than the one before.
        """
        config, turn = self.config, self._n_launchers
        self._n_launchers += 1
        place = (turn % config.point_turns % config.n_points, config.point_turns)
        return self._every_term(poses, place, self.errors, config.two_sided_weight)

    def rescoring_launcher(self, poses: Array, errors: Array, stride: int = 1) -> list[Launch]:
        """The launches that score all of `poses` (n, D) into `errors` (n,), by every `stride`-th
        surface sample, the same in every frame. The two-sided term counts at least as
        `FilterConfig.limb_two_sided` says."""
        return self._every_term(poses, (0, stride), errors, self.config.settling_two_sided)

    def _every_term(
        self, poses: Array, place: tuple[int, int], errors: Array, two_sided: float
    ) -> list[Launch]:
        config = self.config
        weights = config.weights, config.posture_weight
        launches = [self._launch(poses.shape[0], poses, place, *weights, errors)]
        if self._coverage is not None and two_sided > 0:
            launches += self._coverage.launcher(poses, place, two_sided, errors)
        n_views = len(self.rig)
        if self._colours is not None:
            weight = n_views * config.colour_weight
            launches += self._colours.launcher(poses, place, weight, errors)
        if self._smoothness is not None:
            weight = n_views * config.smoothness_weight
            launches += self._smoothness.launcher(poses, weight, errors)
        return launches

    def misfit_launcher(self, poses: Array) -> list[Launch]:
        """Return the launches that put into `misfits` (R,) float32 how badly the first R of `poses`
        (.., D) fit, 0 to 2: the share of the body that lies outside the silhouettes plus the share
        of the surface voxels that it leaves unexplained."""
        weights = np.array([0, 1, 1, 0], np.float32) / np.float32(len(self.rig))
        return [self._launch(self.misfits.size, poses, (0, 1), weights, 0.0, self.misfits)]

    def _launch(
        self,
        n: int,
        poses: Array,
        place: tuple[int, int],
        weights: np.ndarray,
        posture: float,
        errors: Array,
    ) -> Launch:
        """Score the first `n` of `poses`; place: first surface sample looked at, and stride."""
        config = self.config
        return self.device.launch(
            self._kernel("score_poses"),
            pack_size(n, self._defines),
            (self._defines["GROUP"],),
            n_particles=n,
            poses=poses,
            table=self._body,
            n_views=len(self.rig),
            width=self.rig.width,
            height=self.rig.height,
            cameras=self._cameras,
            maps=self._reprojection.maps,
            row_table=self._rows,
            n_points=config.n_points,
            first_point=place[0],
            stride=place[1],
            scale=config.surface_scale,
            points=self.points,
            n_pairs=self._n_pairs,
            pairs=self._pairs,
            habits=self._habits,
            weights=weights,
            posture=posture,
            errors=errors,
        )

    def _fitting_defines(self, body: BodyModel) -> dict[str, int]:
        """The defines of likelihood.cl, with as many cameras at once as local memory holds.

        Raises InputError if the body is too large even for one.
        """
        defines = body_defines(body) | pack_defines(self.device, _GROUP)
        defines["N_ROWS"] = self._rows.shape[0]
        if not self.rig.distorted:
            defines["NO_DISTORTION"] = 1
        defines |= {"OUTLINE_FLOATS": _OUTLINE_FLOATS, "CAMERA_FLOATS": CAMERA_FLOATS}
        n_bones, n_cones, pack = len(body.bones), len(body.cones), 4 * defines["PACK"]
        posed = FRAME_FLOATS * n_bones + (CONE_FLOATS + SPAN_FLOATS) * n_cones
        fixed = pack * (2 * body.n_dof + posed + 5 * defines["GROUP"])
        fixed += self._body.nbytes + self._rows.nbytes
        per_view = pack * (_OUTLINE_FLOATS * n_cones + 2)
        room = self.device.handle.local_mem_size
        views = (room - fixed) // per_view
        if views < 1:
            raise InputError(
                f"the body {body.name} has {n_bones} bones and {n_cones} cones, which need "
                f"{fixed + per_view} bytes of local memory; expected at most {room} on "
                f"{self.device.name}"
            )
        return defines | {"VIEWS": min(views, len(self.rig), defines["GROUP"])}

    def _surface_launch(self, voxels: Voxels) -> Launch:
        return self.device.launch(
            self._kernel("sample_surface"),
            (self.config.n_points,),
            None,
            n_points=self.config.n_points,
            count=voxels.count,
            surface=voxels.surface,
            ny=voxels.grid.shape[1],
            nz=voxels.grid.shape[2],
            origin_size=(0.0, 0.0, 0.0, 0.0),
            points=self.points,
        )

    def _kernel(self, name: str) -> Any:
        return self.device.kernel("tracking/likelihood", name, **self._defines, **CONE_DEFINES)
