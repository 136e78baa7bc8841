"""Errors of poses against the voxels. Twin of apf/likelihood/voxel.py and likelihood.cl."""

from __future__ import annotations

from collections.abc import Sequence
from pkgutil import resolve_name
from typing import NamedTuple

import numpy as np

from apf.body.cones import overlap_errors, project_outlines
from apf.body.kinematics import bone_matrices, posed_cones
from apf.body.limbs import find_hands
from apf.body.model import BodyModel
from apf.likelihood.config import LikelihoodConfig
from apf.likelihood.term import SharedTwin, TermTwin
from apf.likelihood.terms import TERMS
from apf.likelihood.voxel import (
    GRASP_SCALE,
    GRASP_WEIGHT,
    SURFACE_SCALE,
    choose_cone_sampling,
    make_sample_rows,
)
from apf.reference.likelihood.base import NumpyLikelihood
from apf.reference.likelihood.part_colour import is_in_outline, sample_outlines
from apf.scene import Scene
from cl import NumpyDevice
from psfs.cameras.camera import Camera, CameraRig
from psfs.common.cones import cone_distances
from psfs.reference.reprojection import NumpyReprojection
from psfs.voxels.host_voxels import HostVoxels


def image_errors(
    camera: Camera, cones: np.ndarray, maps: np.ndarray, sampling: np.ndarray
) -> np.ndarray:
    """Return (N, C, 4) sums over each cone's samples for one camera, Song et al. eq. (14)-(15).

    cones (N, C, 16), maps (H, W, 2) uint8 silhouette and edge proximity, sampling (C, 2) rows and
    columns. The sums: edge error, edge samples, silhouette error, silhouette samples; samples
    outside the image, and cones with a corner that has no image, count nothing.
    """
    corners = project_outlines(camera, cones)
    sums = np.zeros((*cones.shape[:2], 4))
    for c, (rows, columns) in enumerate(sampling):
        t = ((np.arange(rows) + 0.5) / rows)[:, None, None]
        u = np.concatenate([[0.0], (np.arange(columns) + 0.5) / columns, [1.0]])[:, None]
        quad = corners[:, c, :, None, None]
        pixels = sample_outlines(np.moveaxis(quad, 1, 0), t, u)  # (N, rows, columns + 2, 2)
        x, y = np.moveaxis(np.rint(np.nan_to_num(pixels, nan=-1e6)), -1, 0)
        inside = (x >= 0) & (y >= 0) & (x < camera.size[0]) & (y < camera.size[1])
        value = maps[np.where(inside, y, 0).astype(int), np.where(inside, x, 0).astype(int)]
        error = np.where(inside[..., None], 1 - value / 255.0, 0.0)
        for first, columns_of, channel in ((0, [0, -1], 1), (2, slice(1, -1), 0)):
            sums[:, c, first] = error[:, :, columns_of, channel].sum((1, 2))
            sums[:, c, first + 1] = inside[:, :, columns_of].sum((1, 2))
    return sums


def sampled_surface(centres: np.ndarray, n_points: int) -> np.ndarray:
    """Return `n_points` of the surface voxels (M, 3) m, evenly by index; (0, 3) of none."""
    if len(centres) == 0:
        return centres
    return centres[np.arange(n_points, dtype=np.int64) * len(centres) // n_points]


def subset(points: np.ndarray, turn: int, turns: int) -> np.ndarray:
    """Return the subset of points (K, 3) for one layer: every `turns`-th from number `turn` mod
    `turns` on, ceil(K / turns) points."""
    n = len(points)
    return points[(turn % turns + turns * np.arange(-(-n // turns))) % max(1, n)]


def surface_errors(points: np.ndarray, cones: np.ndarray, scale: float) -> np.ndarray:
    """Return (N,) the mean over points (K, 3) m of d^2 / (d^2 + scale^2), Geman & McClure 1987.

    d is the distance to the nearest cone's surface of cones (N, C, 16); 1 without points.
    """
    if len(points) == 0:
        return np.ones(len(cones))
    errors = []
    for particle in cones:
        nearest = np.abs(cone_distances(points, particle)).min(1)
        errors.append(np.mean(nearest**2 / (nearest**2 + scale**2)))
    return np.array(errors)


def grasp_errors(body: BodyModel, cones: np.ndarray) -> np.ndarray:
    """Return (N,) how far hands are from what they hold, 0 to 1 for each hand.

    The sum over the hands of d^2 / (d^2 + `GRASP_SCALE`^2), d the distance, m, between a hand and
    the nearest lower end of what the person carries, by cones (N, C, 16)."""
    hands, load = cones[:, find_hands(body)], cones[:, len(body.without_load.cones) :]
    if not hands.size:
        return np.zeros(len(cones))
    apart = np.linalg.norm(hands[:, :, None, 4:7] - load[:, None, :, 0:3], axis=-1)
    nearest = (apart - load[:, None, :, 3]).min(-1) - hands[..., 7]
    ratio = np.maximum(nearest, 0) / GRASP_SCALE
    return np.sum(ratio**2 / (1 + ratio**2), 1)


def posture_errors(body: BodyModel, poses: np.ndarray) -> np.ndarray:
    """Return (N,) the sum over the degrees of freedom of the squared distance of poses (N, D) from
    the posture prior's mean, in the body's posture sigmas."""
    return np.sum(((poses - posture_means(body, poses)) / body.posture_sigma) ** 2, 1)


def posture_means(body: BodyModel, poses: np.ndarray) -> np.ndarray:
    """Return the posture prior's means (N, D): rest plus the body's `posture_rise` times the fourth
    power of (1 - c) / 2, where c is the cosine between the z axes of the bone's child and parent, 1
    for an arm that hangs down."""
    means = np.tile(body.rest_pose, (len(poses), 1))
    rising = np.flatnonzero(body.posture_rise)
    up = bone_matrices(body, poses)[0][..., 2]
    for dof, child in zip(rising, body.lifted_bones[rising], strict=True):
        parent = body.bones[body.bones[child].parent].parent
        lift = (1 - np.sum(up[:, child] * up[:, parent], -1)) / 2
        means[:, dof] += body.posture_rise[dof] * lift**4
    return means


class FrameEvidence(NamedTuple):
    """Evidence of a frame: maps (V, H, W, 2) uint8 of the voxels and samples (K, 3) m of their
    surface."""

    maps: np.ndarray
    points: np.ndarray


def total_errors(
    rig: CameraRig,
    cones: np.ndarray,
    observed: FrameEvidence,
    sampling: np.ndarray,
    pairs: Sequence[tuple[int, int]],
    config: LikelihoodConfig,
    terms: Sequence[TermTwin] = (),
) -> np.ndarray:
    """Return (N,) the exponent of Song et al. eq. (16) with its sign corrected.

    Surface and overlap error and silhouette recall are added once per camera. Cameras without a
    sample are replaced by the mean of the others. terms: whose errors in each camera are added.
    """
    errors = np.zeros(len(cones))
    seeing = np.zeros(len(cones))
    for v, (camera, view) in enumerate(zip(rig, observed.maps, strict=True)):
        edge, n_edge, inner, n_inner = np.moveaxis(
            image_errors(camera, cones, view, sampling).sum(1), -1, 0
        )
        seen = (n_edge > 0) & (n_inner > 0)
        error = config.edge_weight * edge / np.maximum(n_edge, 1)
        error = error + config.silhouette_weight * inner / np.maximum(n_inner, 1)
        error = sum((e for term in terms if (e := term.view_errors(v, cones)) is not None), error)
        errors += np.where(seen, error, 0.0)
        seeing += seen
    worst = config.edge_weight + config.silhouette_weight
    mean = np.where(seeing > 0, errors / np.maximum(seeing, 1), worst)
    if config.surface_weight > 0:
        distant = surface_errors(observed.points, cones, SURFACE_SCALE)
        mean = mean + config.surface_weight * distant
    mean = mean + config.overlap_weight * overlap_errors(cones, pairs)
    if config.silhouette_recall_weight > 0:
        mean = mean + config.silhouette_recall_weight * uncovered_errors(
            rig, cones, observed.points
        )
    return len(rig) * mean


class NumpyVoxelLikelihood(NumpyLikelihood):
    """The same as `VoxelLikelihood`, in float64: `observe(voxels)`, then `likelihood(poses)`,
    which looks at subset number `turn` of the surface samples."""

    def __init__(self, scene: Scene, config: LikelihoodConfig) -> None:
        self.body, self.rig, self.config = scene.body, scene.rig, config
        self.unit = float(len(scene.rig))
        self._reprojection = NumpyReprojection(
            NumpyDevice(), scene.rig, scene.voxel_grid, join=config.foreground_join
        )
        self._sampling = choose_cone_sampling(scene.body)
        self.points: np.ndarray = np.empty((0, 3))
        shared = SharedTwin(scene, make_sample_rows(self._sampling))
        self.terms: dict[str, TermTwin] = {
            name: resolve_name(TERMS[name].twin)(shared, settings)
            for name, settings in config.terms.items()
        }

    def forget(self) -> None:
        for term in self.terms.values():
            term.forget()

    def learn(self, pose: np.ndarray) -> None:
        """Learn from a frame whose estimate is `pose` (D,)."""
        for term in self.terms.values():
            term.learn(pose)

    def observe(self, voxels: HostVoxels) -> None:
        self._maps = self._reprojection(voxels)
        self.points = sampled_surface(voxels.cloud().centres, self.config.n_points)
        for term in self.terms.values():
            term.observe(voxels, self._maps)

    def __call__(self, poses: np.ndarray) -> np.ndarray:
        return self._errors(poses, self.turn, self.config.point_turns, self.config)

    def rescore(self, poses: np.ndarray, stride: int, least_recall: float = 0.0) -> np.ndarray:
        """Return errors (N,) of poses (N, D) by every `stride`-th surface sample, and by silhouette
        recall with a weight of at least `least_recall`."""
        weight = max(self.config.silhouette_recall_weight, least_recall)
        return self._errors(poses, 0, stride, self.config.replace(silhouette_recall_weight=weight))

    def _errors(
        self, poses: np.ndarray, turn: int, turns: int, config: LikelihoodConfig
    ) -> np.ndarray:
        body, rig = self.body, self.rig
        cones, points = posed_cones(body, poses), subset(self.points, turn, turns)
        seen = FrameEvidence(self._maps, points)
        terms = list(self.terms.values())
        errors = total_errors(rig, cones, seen, self._sampling, body.apart, config, terms)
        errors = errors + len(rig) * config.posture_prior_weight * posture_errors(body, poses)
        errors = errors + len(rig) * GRASP_WEIGHT * grasp_errors(body, cones)
        for name, term in self.terms.items():
            errors = errors + len(rig) * config.terms[name].weight * term.errors(poses)
        return errors

    def misfit(self, pose: np.ndarray) -> float:
        """Return the misfit of a pose (D,), see `VoxelLikelihood.misfit_launcher`."""
        config = self.config.replace(edge_weight=0.0, silhouette_weight=1.0, surface_weight=1.0,
            overlap_weight=0.0, silhouette_recall_weight=0.0,
        )  # fmt: skip
        cones = posed_cones(self.body, pose[None])
        seen = FrameEvidence(self._maps, self.points)
        errors = total_errors(self.rig, cones, seen, self._sampling, (), config)
        return float(errors[0]) / len(self.rig)


def uncrop(part: np.ndarray, corner: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
    """Return the picture (H, W, ..) of `shape` = (H, W) whose crop `part` (h, w, ..) begins at
    `corner`, row and column; repeat the crop's border outside."""
    rows, columns = (
        np.clip(np.arange(size) - first, 0, inner - 1)
        for size, first, inner in zip(shape, corner, part.shape[:2], strict=True)
    )
    return part[rows[:, None], columns]


def uncovered_errors(rig: CameraRig, cones: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return (N,) the share of the silhouettes that the body leaves uncovered, by its cones.

    The mean over the cameras of the share of points (K, 3) m in their pictures that lie in no
    trapezoid of cones (N, C, 16); cameras that see no point are left out, 1 if none sees any.
    """
    shares = []
    for camera in rig:
        seen = camera.project(points[camera.look_up(points)[0]])[0]
        if len(seen):
            corners = project_outlines(camera, cones)
            shares.append([1 - is_in_outline(one, seen[:, None]).any(-1).mean() for one in corners])
    return np.mean(shares, axis=0) if shares else np.ones(len(cones))
