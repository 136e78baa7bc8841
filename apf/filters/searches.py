"""The searches that are registered, each with its settings, and the objectives: what a search
judges poses by.

Packages register others by the entry points psfs_apf.searches and psfs_apf.objectives. Trackers,
likelihoods and twins are named, not imported: settings are read without OpenCL.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from apf.image_objective.config import OBJECTIVE_KINDS, FeatureConfig, ObjectiveConfig
from psfs.common.config import Config, nonnegative, setting
from psfs.common.registry import Registry


@dataclass(frozen=True)
class SearchSpec:
    """A search as it is registered: in `SEARCHES`, or by an entry point of a package.

    name: by which --method chooses it. meaning: of the name. tracker, twin: a `DeviceTracker` and a
    `NumpyTracker`, as "package.module:Class", which take scene, likelihood=, config= and, by their
    names, settings; they are imported when they are used. settings: classes of the search's own,
    each a part of `Method` by that name. defaults: that it changes in `FilterConfig`, by the names
    of `FilterConfig.create`.
    """

    name: str
    meaning: str
    tracker: str
    twin: str
    settings: Mapping[str, type] = field(default_factory=dict)
    defaults: Mapping[str, object] = field(default_factory=dict)


class SwarmConfig(Config):
    """Factors of a particle swarm, Rymut 2016 eq. (2.27), who does not state his."""

    SOURCE: ClassVar = (
        "by hand: these contract faster than those that Clerc & Kennedy (2002) derive for long "
        "searches (0.73, 1.5, 1.5), which ten iterations are not"
    )

    inertia: float = setting(
        0.6,
        "Share w of its velocity that a particle keeps.",
        least=0,
        below=1,
        flag="--inertia",
        flag_help="pso: share of its velocity that a particle keeps",
    )
    cognitive: float = nonnegative(
        1.2,
        "Pull c1 of a particle's own best.",
        flag="--cognitive",
        flag_help="pso: pull of a particle's own best",
    )
    social: float = nonnegative(
        1.2,
        "Pull c2 of the best of all.",
        flag="--social",
        flag_help="pso: pull of the best of all",
    )


class SirConfig(Config):
    """The observation model of a particle filter with resampling, Rymut 2016 eq. (2.42)."""

    sigma_z: float = nonnegative(
        0.0,
        "Standard deviation of 1 - f; with 0 it is computed in each frame such that the "
        "effective sample size is `SearchConfig.first_survival` of the particles.",
        "not stated by Rymut",
        flag="--sigma-z",
        flag_help="sir: of Rymut eq. (2.42), 0 for one found in each frame",
    )

    @property
    def beta(self) -> float:
        """The exponent of exp(-(1 - f)^2), 0 for one to be found."""
        return self.sigma_z**-2 if self.sigma_z > 0 else 0.0


_ANNEALED = SearchSpec(
    "apf",
    "annealed particle filter",
    tracker="apf.filters.annealed:AnnealedParticleFilter",
    twin="apf.reference.filters.annealed:NumpyAnnealedParticleFilter",
)
_SWARM = SearchSpec(
    "pso",
    "particle swarm",
    tracker="apf.filters.swarm:ParticleSwarm",
    twin="apf.reference.filters.swarm:NumpyParticleSwarm",
    settings={"swarm": SwarmConfig},
    # By hand: a swarm has no annealing, so that more particles spread wider at once; it compares
    # errors of different iterations, which therefore look at the same points; and its parent, the
    # best of all, is a poor guide to velocity.
    defaults={"n_particles": 300, "point_turns": 1, "noise": 0.5, "velocity": 0.0},
)
_SIR = SearchSpec(
    "sir",
    "particle filter",
    tracker="apf.filters.sir:SirParticleFilter",
    twin="apf.reference.filters.annealed:NumpySirParticleFilter",
    settings={"sir": SirConfig},
    # By hand: its one layer must reach as far as the others' layers together.
    defaults={
        "n_particles": 3000,
        "n_layers": 1,
        "first_survival": 0.02,
        "noise": 1.0,
        "velocity": 0.0,
    },
)

#: Every registered search.
SEARCHES = Registry(SearchSpec, "psfs_apf.searches", (_ANNEALED, _SWARM, _SIR))


#: What an objective observes of a frame beside keypoints.
Observes = Literal["voxels", "images", "nothing"]


@dataclass(frozen=True)
class ObjectiveSpec:
    """An objective as it is registered: in `OBJECTIVES`, or by an entry point of a package.

    name: by which --objective chooses it. likelihood, twin: functions (scene, method)
    that return a `Likelihood` and a `NumpyLikelihood`, as "package.module:function"; they are
    imported when they are used. settings: classes of the objective's own, each a part of `Method`
    by that name.
    """

    name: str
    observes: Observes
    likelihood: str
    twin: str
    settings: Mapping[str, type] = field(default_factory=dict)


_OF_VOXELS = (
    ObjectiveSpec(
        "voxel",
        "voxels",
        likelihood="apf.filters.annealed:build_voxel_objective",
        twin="apf.reference.filters.annealed:build_voxel_objective",
    ),
    ObjectiveSpec(
        "keypoints",
        "nothing",
        likelihood="apf.filters.annealed:build_keypoint_objective",
        twin="apf.reference.filters.annealed:build_keypoint_objective",
    ),
)
#: Rymut 2016 eq. (4.46)-(4.50).
_OF_IMAGES = tuple(
    ObjectiveSpec(
        kind,
        "images",
        likelihood="apf.filters.annealed:build_image_objective",
        twin="apf.reference.filters.annealed:build_image_objective",
        settings={"image": ObjectiveConfig, "features": FeatureConfig},
    )
    for kind in OBJECTIVE_KINDS
)

#: Every registered objective.
OBJECTIVES = Registry(ObjectiveSpec, "psfs_apf.objectives", (*_OF_VOXELS, *_OF_IMAGES))
