"""The annealed particle filter over voxels (Song et al. 2.3; Deutscher & Reid 2005)."""

from __future__ import annotations

from collections.abc import Sequence

from apf.filters.base import DeviceTracker
from apf.filters.config import FilterConfig
from apf.filters.particle_set import ParticleSet
from apf.likelihood.base import Likelihood
from apf.likelihood.voxel import VoxelLikelihood
from apf.scene import Scene
from cl import Launch


def voxel_likelihood(scene: Scene, config: FilterConfig, n_runs: int = 1) -> VoxelLikelihood:
    """Return the voxels' likelihood for a filter of these settings and so many runs."""
    search = config.search
    return VoxelLikelihood(scene, config.likelihood, search.n_particles, n_runs, search.velocity)


class AnnealedParticleFilter(DeviceTracker):
    """Tracks the body of a scene through its voxels. Twin: reference/filters/annealed.py.

    With a `likelihood` of its own it tracks through whatever that observes, image features say, and
    the scene needs no grid. With several `seeds` it makes as many runs at once, each bit by bit
    that of its seed alone, for `step_runs`; a likelihood of its own then has room for the particles
    of all.
    """

    def __init__(
        self,
        scene: Scene,
        config: FilterConfig | None = None,
        *,
        likelihood: Likelihood | None = None,
        seeds: Sequence[int] | None = None,
    ) -> None:
        config = config or FilterConfig()
        if likelihood is None:
            likelihood = voxel_likelihood(scene, config, len(seeds or [0]))
        particles = ParticleSet(scene.opencl, scene.body, config.search, seeds)
        super().__init__(scene, likelihood, particles, config)

    def _search(self, source: int) -> list[Launch]:
        launches = [self.particles.diffuse(0, source)]
        for layer in range(self.config.search.n_layers):
            source = 1 - source
            launches += self.likelihood.launcher(self.particles.sets[source])
            launches += self.particles.renew(layer, self.likelihood.errors, source)
        return launches
