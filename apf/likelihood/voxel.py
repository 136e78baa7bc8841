"""Errors of all particles against the voxels on the device (kernel: likelihood.cl)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pyopencl

from apf.body.limbs import find_hands
from apf.body.model import BodyModel
from apf.body.posing import CONE_DEFINES, FRAME_FLOATS, SPAN_FLOATS, body_defines, pack_body
from apf.likelihood.base import Likelihood, PointSubset
from apf.likelihood.config import EXCHANGE_COST, KeypointConfig, LikelihoodConfig
from apf.likelihood.contour import N_NORMALS
from apf.likelihood.observations import POINT_REACH, ObservedPoints
from apf.likelihood.part_colour import N_CODES, RATIO_STEPS, find_trunk_cone, list_scored_parts
from apf.likelihood.term import Shared, make_terms
from apf.scene import Scene
from cl import Array, InputError, Kernel, Launch
from cl.signature import Argument
from cl.staging import Ahead
from cl.workgroups import WIDE_GROUP, pack_defines, pack_size
from psfs.cameras.camera import CameraRig
from psfs.common.cones import CONE_FLOATS
from psfs.voxels.device_voxels import CarvedVoxels
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.reprojection import Reprojection

#: Floats of a cone's outline in a picture: x and y of its corners; and of its edges, three each.
_OUTLINE_FLOATS, _EDGE_FLOATS = 8, 12
#: Distance between the samples on a cone, m: as accurate as 0.05, in less time.
_SAMPLE_SPACING = 0.06
#: Distance, m, at which a surface voxel is half unexplained (Geman & McClure 1987): about that of a
#: body's surface from its cones and from the hull of few cameras.
SURFACE_SCALE = 0.05
#: Distance, m, of a hand from the lower end of what it holds, from below or beside, that is half
#: out of its grasp, and weight of each hand's error, counted once per camera. Arms that lie before
#: a box show in no picture, and would reach for its upper rim, which round parts explain badly.
GRASP_SCALE, GRASP_WEIGHT = 0.1, 0.4
#: Fewest rows and columns of samples on a cone: the shortest one, too, shows its outline.
_FEWEST_SAMPLES = (4, 3)
#: Numbers that score_poses adds up per camera, and items that add up each; numbers that it keeps of
#: a camera then.
_SUMS, _ADDERS, _VIEW_FLOATS = 10, 8, 5


def choose_cone_sampling(body: BodyModel, spacing: float = _SAMPLE_SPACING) -> np.ndarray:
    """Return (C, 2) int32 numbers of sample rows along and columns across each cone, about
    `spacing` m apart; 0 for cones that are not compared with images."""
    rows = [np.linalg.norm(cone.end - cone.start) / spacing for cone in body.cones]
    columns = [np.mean(cone.radii) * 2 / spacing for cone in body.cones]
    sampling = np.maximum(np.ceil(np.stack([rows, columns], -1)), _FEWEST_SAMPLES).astype(np.int32)
    sampling[[not cone.in_images for cone in body.cones]] = 0
    return sampling


def make_sample_rows(sampling: np.ndarray) -> np.ndarray:
    """Return (R, 4) float32 sample rows for the `sampling` (C, 2) of `choose_cone_sampling`: cone,
    position along it from 0 to 1, n columns, 1 / n. Sort the longest rows first, so that rows
    processed together have about the same length."""
    rows = [
        (cone, (row + 0.5) / n_rows, n_columns, 1 / n_columns)
        for cone, (n_rows, n_columns) in enumerate(sampling)
        for row in range(n_rows)
    ]
    rows.sort(key=lambda row: -row[2])
    return np.array(rows, np.float32).reshape(-1, 4)


def posture_prior(body: BodyModel) -> np.ndarray:
    """Return (D, 4) float32: rest pose, 1 / sigma, which is 0 for a uniform prior, and the rise of
    the mean with the lift of which bone."""
    prior = [body.rest_pose, 1 / body.posture_sigma, body.posture_rise, body.lifted_bones]
    return np.stack(prior, -1).astype(np.float32)


def _frame_array_shapes(
    rig: CameraRig, config: LikelihoodConfig
) -> list[tuple[tuple[int, ...], type[np.generic]]]:
    """Return shapes and types of a frame's arrays: maps, contours, colour codes, surface samples
    and their pixels. Contours and codes have a single element if their term is off."""
    views, *size = len(rig), rig.height, rig.width
    n_points = config.n_points
    contours = (views, N_NORMALS, *size) if "contour" in config.terms else (1,)
    codes = (views, *size) if "part_colour" in config.terms else (1,)
    bytes_: list[tuple[tuple[int, ...], type[np.generic]]]
    bytes_ = [((views, *size, 2), np.uint8), (contours, np.uint8), (codes, np.uint8)]
    return [*bytes_, ((n_points, 4), np.float32), ((views, n_points, 2), np.float32)]


class VoxelLikelihood(Likelihood):
    """Likelihood of poses given voxels: their reprojection into the cameras, and the surface voxels
    themselves.

    `errors` is Song et al. eq. (16) with its sign corrected, plus further terms, see
    `LikelihoodConfig`. seen: maps, contours and codes of the latest frame, which poses are scored
    against. Twin: reference/likelihood/voxel.py.
    """

    points: Array
    misfits: Array
    misfits_of_all = True

    def __init__(self, scene: Scene, config: LikelihoodConfig, n_particles: int) -> None:
        device, body, rig = scene.opencl, scene.body, scene.rig
        self.device, self.rig, self.config = device, rig, config
        self.unit = float(len(rig))
        self._grid: VoxelGrid | None = None
        self._voxels: CarvedVoxels | None = None
        self._ahead = Ahead(device, _frame_array_shapes(rig, config), "what is seen of a frame")
        maps, contours, codes, points, pixels = zip(
            self._ahead.written, self._ahead.read, strict=True
        )
        self.reprojection = Reprojection(
            device, rig, scene.voxel_grid, join=config.foreground_join, maps=maps[0]
        )
        self.seen = {"maps": maps[1], "contours": contours[1], "codes": codes[1]}
        self._body = device.to_device(pack_body(body), "the body model")
        rows = make_sample_rows(choose_cone_sampling(body))
        self._rows = device.to_device(rows, "the cones' samples")
        self._defines = self._choose_defines(body)
        self._n_pairs, self._load = len(body.apart), len(body.without_load.cones)
        pairs = np.array(body.apart or [(0, 0)], np.int32)
        self._pairs = device.to_device(pairs, "the parts that stay apart")
        hands = find_hands(body)
        self._n_hands = len(hands)
        self._hands = device.to_device(np.array(hands or [0], np.int32), "the hands")
        self._posture = device.to_device(posture_prior(body), "the posture prior")
        self._cameras = device.to_device(rig.packed(), "the cameras")
        self.n_launchers = 0
        self._scores: list[Launch] = []
        self.points, self._pixels = points[1], pixels[1]
        self._sampled = {"points": points[0], "pixels": pixels[0]}
        self.errors = device.empty((n_particles,), np.float32, "the errors")
        self.misfits = device.zeros((1,), np.float32)
        self._row_parts = device.to_device(list_scored_parts(body, rows))
        self._point_arguments: dict[str, Argument] = {
            "observed": None, "point_weight": 0.0, "point_reach": 1.0, "exchange": 0.0
        }  # fmt: skip
        seen = {"contours": contours, "codes": codes}
        shared = Shared(scene, self._cameras, maps[0], seen)
        self.terms = make_terms(shared, config.terms)
        self._uses_pictures = any(term.uses_pictures for term in self.terms.values())
        self._arguments: dict[str, Argument] = {"ratios": device.zeros((1,), np.int8)}
        self._weights = {"colour_weight": 0.0, "contour_weight": 0.0}
        for term in self.terms.values():
            self._arguments |= term.score_arguments()
        self._weighed: list[Launch] = []

    def change_body(self, body: BodyModel) -> None:
        self._body.set(pack_body(body))
        self._posture.set(posture_prior(body))
        rows = make_sample_rows(choose_cone_sampling(body))
        self._rows = self.device.to_device(rows, "the cones' samples")
        self._row_parts = self.device.to_device(list_scored_parts(body, rows))
        for launch in self._scores:
            launch.set(**self._row_arguments())
        for term in self.terms.values():
            term.change_body(body)

    def forget(self) -> None:
        for term in self.terms.values():
            term.forget()

    def learning_launcher(self, pose: Array) -> list[Launch]:
        return [launch for term in self.terms.values() for launch in term.learning_launcher(pose)]

    def observe(self, voxels: CarvedVoxels) -> None:
        """Enqueue the maps of `voxels` and the sampling of the surface voxels."""
        self.prepare(voxels)()

    def show(self) -> None:
        """Score poses against the prepared frame from now on."""
        self._ahead.show()

    def prepare(self, voxels: CarvedVoxels) -> Callable[[], None]:
        """Enqueue all of `observe` except `show`; return `show`."""
        if voxels is self._voxels and voxels.stays:
            return self.show
        self.reprojection(voxels)
        if voxels is not self._voxels:
            self._voxels, self._grid = voxels, None
            self._sample_surface = self._sampling_launch(voxels)
        if voxels.grid is not self._grid:
            self._grid = voxels.grid
            position = [*voxels.grid.origin, voxels.grid.voxel_size]
            self._sample_surface.set(origin_size=position)
        self._sample_surface()
        pictures = voxels.pictures() if self._uses_pictures else None
        weights: dict[str, float] = {}
        for term in self.terms.values():
            term.observe(voxels, pictures)
            weights |= term.score_weights()
        if weights != self._weights:
            self._weights = weights
            for launch in self._weighed:
                launch.set(**weights)
        return self.show

    def launcher(self, poses: Array) -> list[Launch]:
        """Return the launches that score `poses` (N, D) float32 into `errors`.

        Each call uses the next subset of the surface samples in turn.
        """
        config, turn = self.config, self.n_launchers
        self.n_launchers += 1
        subset = PointSubset(turn % config.point_turns % config.n_points, config.point_turns)
        return self._score_all_terms(poses, subset, self.errors, config.silhouette_recall_weight)

    def rescoring_launcher(
        self,
        poses: Array,
        errors: Array,
        stride: int = 1,
        least_recall: float = 0.0,
        misfits: Array | None = None,
    ) -> list[Launch]:
        """Return the launches that score all of `poses` (n, D) into `errors` (n,) by every
        `stride`-th surface sample, the same in every frame, and by silhouette recall with a weight
        of at least `least_recall`. `misfits` (n,) gets theirs, for a stride of 1."""
        recall_weight = max(self.config.silhouette_recall_weight, least_recall)
        return self._score_all_terms(poses, PointSubset(0, stride), errors, recall_weight, misfits)

    def take_points(self, observed: ObservedPoints, config: KeypointConfig) -> bool:
        """Add the term of observed points to the errors of all launches asked for from now on."""
        self._point_arguments = {
            "observed": observed.table,
            "point_weight": config.weight,
            "point_reach": POINT_REACH,
            "exchange": EXCHANGE_COST,
        }
        return True

    def _score_all_terms(
        self,
        poses: Array,
        subset: PointSubset,
        errors: Array,
        recall_weight: float,
        misfits: Array | None = None,
    ) -> list[Launch]:
        config, n = self.config, poses.shape[0]
        arguments: dict[str, Argument] = {
            **{"weights": config.weights, "posture_weight": config.posture_prior_weight},
            **{"grasp_weight": GRASP_WEIGHT, "recall_weight": recall_weight},
            **{"errors": errors, "misfits": misfits},
            **self._point_arguments,
        }
        score = self._launch(n, poses, subset, **arguments)
        self._weighed.append(score)
        score.set(**self._weights)
        launches = [score]
        for name, term in self.terms.items():
            launches += term.launcher(poses, len(self.rig) * config.terms[name].weight, errors)
        return launches

    def misfit_launcher(self, poses: Array) -> list[Launch]:
        """Return the launches that write the misfit of the first of `poses` (.., D): silhouette and
        surface term, averaged over the cameras."""
        weights = np.array([0, 1, 1, 0], np.float32) / np.float32(len(self.rig))
        arguments: dict[str, Argument] = {
            **{"weights": weights, "posture_weight": 0.0, "recall_weight": 0.0},
            "grasp_weight": 0.0,
            **{**self._point_arguments, "errors": self.misfits, "misfits": None, "observed": None},
        }
        return [self._launch(1, poses, PointSubset(0, 1), **arguments)]

    def _launch(self, n: int, poses: Array, subset: PointSubset, **arguments: Argument) -> Launch:
        """Return the launch that scores the first `n` of `poses` by a subset of the samples and by
        the term of observed points; arguments: of the kernel, the weights and arrays."""
        config = self.config
        launch = self.device.launch(
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
            **self.seen,
            **self._row_arguments(),
            n_points=config.n_points,
            first_point=subset.first,
            stride=subset.stride,
            scale=SURFACE_SCALE,
            points=self.points,
            pixels=self._pixels,
            n_pairs=self._n_pairs,
            pairs=self._pairs,
            n_hands=self._n_hands,
            hands=self._hands,
            load=self._load,
            reach=GRASP_SCALE,
            posture=self._posture,
            **self._arguments,
            colour_weight=0.0,
            contour_weight=0.0,
            **arguments,
        )
        self._scores.append(launch)
        return launch

    def _sampling_launch(self, voxels: CarvedVoxels) -> Launch:
        """Return the launch that samples the surface of a frame; its argument `origin_size` is to
        be set."""
        defines = pack_defines(self.device, WIDE_GROUP) | self.rig.defines
        return self.device.launch(
            self.device.kernel("tracking/surface_samples", "sample_surface", **defines),
            (-(-self.config.n_points // defines["PACK"]),),
            (64,),
            n_points=self.config.n_points,
            n_views=len(self.rig),
            count=voxels.count,
            surface=voxels.surface,
            ny=voxels.grid.shape[1],
            nz=voxels.grid.shape[2],
            origin_size=(0.0, 0.0, 0.0, 0.0),
            cameras=self._cameras,
            **self._sampled,
        )

    def _row_arguments(self) -> dict[str, Argument]:
        """Return the arguments of score_poses that depend on the number of sample rows."""
        room = pyopencl.LocalMemory(self._rows.nbytes)
        return {
            "n_rows": self._rows.shape[0],
            "row_table": self._rows,
            "row_parts": self._row_parts,
            "rows": room,
        }

    def _choose_defines(self, body: BodyModel) -> dict[str, int]:
        """Return the defines of likelihood.cl, with as many cameras at once as local memory holds.

        Raises InputError if the body is too large even for one.
        """
        defines = body_defines(body) | pack_defines(self.device, WIDE_GROUP)
        if not self.rig.distorted:
            defines["NO_DISTORTION"] = 1
        defines |= {"OUTLINE_FLOATS": _OUTLINE_FLOATS, "EDGE_FLOATS": _EDGE_FLOATS}
        defines |= self.rig.defines
        defines |= {"N_CODES": N_CODES, "RATIO_STEPS": RATIO_STEPS, "TRUNK": find_trunk_cone(body)}
        n_bones, n_cones, pack = len(body.bones), len(body.cones), 4 * defines["PACK"]
        posed = FRAME_FLOATS * n_bones + (CONE_FLOATS + SPAN_FLOATS) * n_cones
        items = _SUMS * (defines["GROUP"] + _SUMS) + defines["GROUP"]
        fixed = pack * (2 * body.n_dof + posed + items) + self._body.nbytes + self._rows.nbytes
        outlined = (_OUTLINE_FLOATS + _EDGE_FLOATS) * n_cones
        per_view = pack * (outlined + _SUMS * (_ADDERS + 1) + _VIEW_FLOATS)
        room = self.device.handle.local_mem_size
        views = (room - fixed) // per_view
        if views < 1:
            raise InputError(
                f"the body {body.name} has {n_bones} bones and {n_cones} cones, which need "
                f"{fixed + per_view} bytes of local memory; expected at most {room} on "
                f"{self.device.name}"
            )
        return defines | {"VIEWS": min(views, len(self.rig), defines["GROUP"])}

    def _kernel(self, name: str) -> Kernel:
        return self.device.kernel("tracking/likelihood", name, **self._defines, **CONE_DEFINES)
