"""Every search over every objective: what `apf track --method M --objective O` chooses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from apf.filters.config import KEYPOINTS_ON, FilterConfig
from apf.filters.sir import SirConfig
from apf.filters.swarm import SwarmConfig
from apf.image_objective.config import OBJECTIVE_KINDS, FeatureConfig, ObjectiveConfig
from cl import InputError
from psfs.cameras.names import listed
from psfs.common.configs import changed_config
from psfs.common.ranges import check_range

SEARCHES = ("apf", "pso", "sir")
#: The voxels' likelihood, keypoints alone, and the image objectives of Rymut 2016 eq.
#: (4.46)-(4.50).
OBJECTIVES = ("voxel", "keypoints", *OBJECTIVE_KINDS)

#: What a search changes in the defaults of FilterConfig. By hand: a swarm has no annealing, so that
#: more particles spread wider at once; it compares errors of different iterations, which therefore
#: look at the same points; and its parent, the best of all, is a poor guide to velocity.
SEARCH_DEFAULTS: dict[str, dict[str, Any]] = {
    "apf": {},
    "pso": {"n_particles": 300, "point_turns": 1, "noise": 0.5, "velocity": 0.0},
    # Its one layer must reach as far as the others' layers together.
    "sir": {
        "n_particles": 3000,
        "n_layers": 1,
        "first_survival": 0.02,
        "noise": 1.0,
        "velocity": 0.0,
    },
}


@dataclass(frozen=True)
class Method:
    """A search, an objective and the settings of both; those of others are not looked at.

    filter: of every search (n_layers are the swarm's iterations) and of the voxels' likelihood.
    A swarm compares errors of different iterations: with it, `point_turns` should be 1. recover:
    whether a person who was lost is looked for again, which no paper does. both_ways: whether a
    take is tracked back, too, see `apf.tracking.two_way`; image features are not. runs: how many
    runs, each both ways, make a track then.
    """

    search: str = "apf"
    objective: str = "voxel"
    recover: bool = True
    both_ways: bool = True
    runs: int = 2
    filter: FilterConfig = field(default_factory=FilterConfig)
    swarm: SwarmConfig = field(default_factory=SwarmConfig)
    sir: SirConfig = field(default_factory=SirConfig)
    image: ObjectiveConfig = field(default_factory=ObjectiveConfig)
    features: FeatureConfig = field(default_factory=FeatureConfig)

    def __post_init__(self) -> None:
        if self.search not in SEARCHES:
            raise InputError(f"the method is {self.search!r}; expected {listed(SEARCHES)}")
        if self.objective not in OBJECTIVES:
            raise InputError(f"the objective is {self.objective!r}; expected {listed(OBJECTIVES)}")
        check_range("the method: runs", self.runs, 1, ends=True)
        if self.uses_images:
            object.__setattr__(self, "image", replace(self.image, kind=self.objective))
        if self.objective == "keypoints" and not self.uses_keypoints:
            object.__setattr__(self, "filter", self.filter.changed(**KEYPOINTS_ON))

    @classmethod
    def of(cls, search: str = "apf", objective: str = "voxel", **settings: Any) -> Method:
        """Return a method with the search's own defaults and single `settings` of its filter, named
        as in `FilterConfig.of`."""
        config = FilterConfig.of(**{**SEARCH_DEFAULTS.get(search, {}), **settings})
        return cls(search, objective, filter=config)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], where: str = "") -> Method:
        """Return the inverse of `dataclasses.asdict`; what is not stated has the search's own
        default. Arguments and errors as of `config_of`."""
        search = values.get("search")
        base = cls.of(search) if search in SEARCHES else cls()
        return changed_config(base, values, where)

    @property
    def uses_voxels(self) -> bool:
        """Whether the objective is the voxels' likelihood."""
        return self.objective == "voxel"

    @property
    def uses_images(self) -> bool:
        """Whether the objective is one over image features."""
        return self.objective in OBJECTIVE_KINDS

    @property
    def goes_back(self) -> bool:
        """Whether a take is tracked both ways."""
        return self.both_ways and not self.uses_images

    @property
    def n_runs(self) -> int:
        """How many runs make a track."""
        return self.runs if self.goes_back else 1

    @property
    def uses_keypoints(self) -> bool:
        """Whether keypoints have a weight, beside the objective or alone."""
        return self.filter.keypoints.weight > 0

    def with_keypoints(self, n_sightings: int) -> Method:
        """Return the method with room for so many keypoints in a frame; with their usual weight
        unless they have one."""
        room = max(self.filter.keypoints.room, n_sightings)
        weight = {} if self.uses_keypoints else KEYPOINTS_ON
        return replace(self, filter=self.filter.changed(keypoints_room=room, **weight))

    def described(self) -> dict[str, Any]:
        """Return what was used, for a track's provenance."""
        used = {
            "method": self.search,
            "objective": self.objective,
            "recover": self.recover,
            "both_ways": self.goes_back,
            "runs": self.n_runs,
            "filter": self.filter.settings,
        }
        if self.search == "pso":
            used["swarm"] = asdict(self.swarm)
        if self.search == "sir":
            used["sir"] = asdict(self.sir)
        if self.uses_images:
            used |= {"image": asdict(self.image), "features": asdict(self.features)}
        return used
