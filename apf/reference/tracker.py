"""The annealed particle filter in NumPy. Twin of apf/tracker.py."""

from __future__ import annotations

import numpy as np

from apf.body import BodyModel
from apf.config import FilterConfig
from apf.likelihood import cone_sampling
from apf.reference.annealing import (
    annealing_exponent,
    diffuse,
    effective_size,
    normalised_weights,
    systematic_parents,
)
from apf.reference.kinematics import posed_cones
from apf.reference.likelihood import sampled_surface, share, total_errors
from apf.reference.noise import normals, uniform
from apf.reference.refine import refined
from apf.tracker import Estimate, checked_pose
from cl import NumpyDevice
from psfs.camera import CameraRig
from psfs.grid import VoxelGrid
from psfs.reference.reconstruct import NumpyVoxels
from psfs.reference.reprojection import NumpyReprojection


class NumpyAnnealedParticleFilter:
    """Song et al. eq. (10)-(13), step by step; same signature as AnnealedParticleFilter."""

    def __init__(
        self,
        device: NumpyDevice,
        body: BodyModel,
        rig: CameraRig,
        grid: VoxelGrid,
        config: FilterConfig | None = None,
    ) -> None:
        self.body, self.rig, self.grid = body, rig, grid
        self.config = config or FilterConfig()
        self._reprojection = NumpyReprojection(device, rig, grid)
        self._sampling = cone_sampling(body, self.config.sample_spacing)

    def start(self, pose: np.ndarray) -> None:
        """Put all particles at `pose` (D,)."""
        n = self.config.n_particles
        self._poses = np.tile(checked_pose(self.body, pose), (n, 1))
        self._parents = np.arange(n)
        self._frame = 0
        self._last, self._drift = np.zeros((2, self.body.n_dof))

    def step(self, voxels: NumpyVoxels) -> Estimate:
        """Track one frame further."""
        config, body = self.config, self.body
        maps = self._reprojection(voxels)
        points = sampled_surface(voxels.cloud().centres, config.n_points)
        history = []
        for layer in range(config.n_layers):
            self._poses = diffuse(
                self._poses, self._parents, self._noise(layer), body.lower, body.upper
            )
            cones = posed_cones(body, self._poses)
            # Launchers are made for two frames, which may end in different particle sets.
            turn = layer + self._frame % 2 * config.n_layers
            seen = share(points, turn, config.point_turns)
            errors = total_errors(self.rig, cones, maps, seen, self._sampling, body.apart, config)
            beta = annealing_exponent(errors, config.survival_rates[layer])
            history.append((effective_size(errors, beta), beta, errors.min()))
            weights = normalised_weights(errors, beta)
            offset = uniform(config.seed, self._frame, layer)
            self._parents = systematic_parents(weights, offset)
            mean = weights @ self._poses
            self._deviation = np.sqrt(weights @ (self._poses - mean) ** 2)
        pose = refined(body, mean, points, config)
        # The first frame's change is the start's error, not a motion.
        change = pose - self._last if self._frame > 0 else np.zeros(body.n_dof)
        self._last, self._drift = pose, pose - mean + config.velocity * change
        self._frame += 1
        ess, beta, least_error = np.array(history).T
        return Estimate(pose, self._deviation, ess, beta, least_error)

    def _noise(self, layer: int) -> np.ndarray:
        """(N, D) what the layer adds to the particles: noise, first the expected motion too."""
        config = self.config
        deviation = config.layer_noise[layer] * self.body.sigma
        if config.spread > 0 and layer > 0:
            deviation = np.minimum(deviation, config.spread * self._deviation)
        shape = (config.n_particles, self.body.n_dof)
        noise = deviation * normals(config.seed, self._frame, layer, *shape)
        return noise + self._drift if layer == 0 else noise
