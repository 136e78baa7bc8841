"""The searches: annealed particle filter (Song et al. 2.3; Deutscher & Reid 2005), swarm and SIR
filter (Rymut 2016), and what refines their estimates."""

from apf.filters.annealed import AnnealedParticleFilter
from apf.filters.base import DeviceTracker, Estimate, Tracker
from apf.filters.config import FilterConfig, LimbSearchConfig, RefinementConfig, SearchConfig
from apf.filters.limb_search import LimbSearch
from apf.filters.method import Method
from apf.filters.particle_set import ParticleSet
from apf.filters.refinement import Refinement
from apf.filters.sir import SirConfig, SirParticleFilter
from apf.filters.swarm import ParticleSwarm, SwarmConfig

__all__ = [
    "AnnealedParticleFilter",
    "DeviceTracker",
    "Estimate",
    "FilterConfig",
    "LimbSearch",
    "LimbSearchConfig",
    "Method",
    "ParticleSet",
    "ParticleSwarm",
    "Refinement",
    "RefinementConfig",
    "SearchConfig",
    "SirConfig",
    "SirParticleFilter",
    "SwarmConfig",
    "Tracker",
]
