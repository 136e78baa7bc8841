"""What the NumPy searches share, and the voxel likelihood as their scorer. Twin of `Tracker`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from apf.body.kinematics import posed_cones
from apf.filters.annealed import Estimate, checked_pose
from apf.filters.config import FilterConfig
from apf.filters.layer_noise import layer_sigmas
from apf.likelihood.voxel import cone_sampling
from apf.reference.likelihood import posture_errors, sampled_surface, share, total_errors
from apf.reference.limb_search import settled
from apf.reference.motion_prior import expectation, jump_errors
from apf.reference.noise import normals
from apf.reference.part_colour import chromaticities, colour_errors, learnt
from apf.scene import Scene
from cl import InputError, NumpyDevice
from psfs.reference.reprojection import NumpyReprojection
from psfs.voxels.host_voxels import HostVoxels


class NumpyVoxelLikelihood:
    """The same as `VoxelLikelihood`, in float64: `observe(voxels)`, then `likelihood(poses)`,
    which looks at share number `turn` of the surface samples."""

    def __init__(self, scene: Scene, config: FilterConfig) -> None:
        self.body, self.rig, self.config = scene.body, scene.rig, config
        self._reprojection = NumpyReprojection(NumpyDevice(), scene.rig, scene.voxel_grid)
        self._sampling = cone_sampling(scene.body, config.sample_spacing)
        self.points, self._colours = np.empty((0, 3)), np.empty((0, 3))
        self.turn = 0
        self.forget()

    def forget(self) -> None:
        """A new track begins: no colour is known, no pose expected."""
        self.parts = np.zeros((len(self.body.cones), 3))
        self.motion = np.full((self.body.n_dof, 2), np.nan)

    def learn(self, pose: np.ndarray) -> None:
        """End a frame whose estimate is `pose` (D,)."""
        config = self.config
        self.motion = expectation(self.motion, pose, config.velocity)
        if config.colour_weight > 0:
            cones = posed_cones(self.body, pose[None])[0]
            scale, rate = config.surface_scale, config.colour_rate
            self.parts = learnt(self.parts, self.points, self._colours, cones, scale, rate)

    def observe(self, voxels: HostVoxels) -> None:
        """Take the voxels of a frame. Raises InputError if a term lacks pictures."""
        self._maps = self._reprojection(voxels)
        self.points = sampled_surface(voxels.cloud().centres, self.config.n_points)
        if self.config.colour_weight > 0:
            if voxels.colours is None:
                raise InputError(
                    "the likelihood's term colour: the frame has no pictures to colour its voxels "
                    "with; expected images"
                )
            colours = sampled_surface(voxels.colours(), self.config.n_points)
            self._colours = chromaticities(colours)

    def __call__(self, poses: np.ndarray) -> np.ndarray:
        """Errors (N,) of poses (N, D)."""
        return self._errors(poses, self.turn, self.config.point_turns, self.config)

    def rescore(self, poses: np.ndarray, stride: int) -> np.ndarray:
        """Errors (N,) of poses (N, D) by every `stride`-th surface sample."""
        settling = replace(self.config, two_sided_weight=self.config.settling_two_sided)
        return self._errors(poses, 0, stride, settling)

    def _errors(self, poses: np.ndarray, turn: int, turns: int, config: FilterConfig) -> np.ndarray:
        body, rig = self.body, self.rig
        cones, seen = posed_cones(body, poses), share(self.points, turn, turns)
        errors = total_errors(rig, cones, self._maps, seen, self._sampling, body.apart, config)
        errors = errors + len(rig) * config.posture_weight * posture_errors(body, poses)
        if config.colour_weight > 0:
            samples = share(self._colours, turn, turns)
            found = colour_errors(seen, samples, self.parts, cones, config.colour_scale)
            errors = errors + len(rig) * config.colour_weight * found
        if config.smoothness_weight > 0:
            found = jump_errors(body, poses, self.motion[:, 1], config)
            errors = errors + len(rig) * config.smoothness_weight * found
        return errors

    def misfit(self, pose: np.ndarray) -> float:
        """See `VoxelLikelihood.misfit_launcher`, of a pose (D,)."""
        config = replace(
            self.config, edge_weight=0.0, silhouette_weight=1.0, surface_weight=1.0,
            overlap_weight=0.0, two_sided_weight=0.0,
        )  # fmt: skip
        cones = posed_cones(self.body, pose[None])
        errors = total_errors(self.rig, cones, self._maps, self.points, self._sampling, (), config)
        return float(errors[0]) / len(self.rig)


class NumpyTracker:
    """`start(pose)` once, then `step(observation)` per frame, as `apf.filters.annealed.Tracker`.

    `scorer` has `observe(observation)` and, called with poses (N, D), gives their errors (N,);
    where it has `points` (K, 3), the estimate is refined on them.
    """

    def __init__(self, scene: Scene, scorer: Any, config: FilterConfig) -> None:
        self.body, self.scorer, self.config = scene.body, scorer, config

    def start(self, pose: np.ndarray) -> None:
        """Put all particles at `pose` (D,)."""
        n = self.config.n_particles
        self._poses = np.tile(checked_pose(self.body, pose), (n, 1))
        self._parents = np.arange(n)
        self._frame = 0
        self._last, self._drift, self._deviation = np.zeros((3, self.body.n_dof))
        if hasattr(self.scorer, "forget"):
            self.scorer.forget()

    def step(self, observation: Any) -> Estimate:
        """Track one frame further."""
        self.scorer.observe(observation)
        found = self._search()
        pose, information = found.pose, np.zeros((self.body.n_dof, self.body.n_dof))
        if hasattr(self.scorer, "points"):
            pose, information = settled(self.body, self.scorer, pose, self.config, self._frame + 1)
        misfit = self.scorer.misfit(pose) if hasattr(self.scorer, "misfit") else np.nan
        # The first frame's change is the start's error, not a motion.
        change = pose - self._last if self._frame > 0 else np.zeros(self.body.n_dof)
        self._last, self._drift = pose, pose - found.pose + self.config.velocity * change
        self._frame += 1
        if hasattr(self.scorer, "learn"):
            self.scorer.learn(pose)
        return replace(found, pose=pose, information=information, misfit=misfit)

    def stream(self, observations: Iterable[Any]) -> Iterator[Estimate]:
        """`step` for each of the observations."""
        return map(self.step, observations)

    def _search(self) -> Estimate:
        raise NotImplementedError

    def _take_turn(self, turn: int) -> None:
        """Say which of the launchers that a device's tracker makes is meant."""
        if isinstance(self.scorer, NumpyVoxelLikelihood):
            self.scorer.turn = turn

    def _noise(self, layer: int) -> np.ndarray:
        """(N, D) what the layer adds to the particles: noise, first the expected motion too."""
        config = self.config
        shape = (config.n_particles, self.body.n_dof)
        deviation = config.layer_noise[layer] * layer_sigmas(self.body, config)[layer]
        if config.spread > 0 and layer > 0:
            deviation = np.minimum(deviation, config.spread * self._deviation)
        noise = deviation * normals(config.seed, self._frame, layer, *shape)
        return noise + self._drift if layer == 0 else noise
