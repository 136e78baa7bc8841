"""Every search over every objective: what `apf track --method M --objective O` chooses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from itertools import chain
from typing import Any

from apf.filters.config import KEYPOINTS_ON, FilterConfig
from apf.filters.objectives import OBJECTIVES, ObjectiveSpec
from apf.filters.searches import SEARCHES
from apf.filters.searches.sir import SirConfig
from apf.filters.searches.swarm import SwarmConfig
from apf.image_objective.config import FeatureConfig, ObjectiveConfig
from cl import InputError
from psfs.cameras.names import listed
from psfs.common.configs import changed_config, with_settings
from psfs.common.ranges import check_range

#: Settings that searches and objectives have of their own, by the names that they have in `Method`.
_OWN_SETTINGS = dict(
    chain(
        *(search.settings.items() for search in SEARCHES.values()),
        *(objective.settings.items() for objective in OBJECTIVES.values()),
    )
)


@dataclass(frozen=True)
@with_settings(_OWN_SETTINGS)
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
        for what, name, known in (
            ("method", self.search, SEARCHES), ("objective", self.objective, OBJECTIVES)
        ):  # fmt: skip
            if name not in known:
                raise InputError(f"the {what} is {name!r}; expected {listed(tuple(known))}")
        check_range("the method: runs", self.runs, 1, ends=True)
        if "image" in self._objective.settings:
            object.__setattr__(self, "image", replace(self.image, kind=self.objective))
        if self.objective == "keypoints" and not self.uses_keypoints:
            object.__setattr__(self, "filter", self.filter.changed(**KEYPOINTS_ON))

    @classmethod
    def of(cls, search: str = "apf", objective: str = "voxel", **settings: Any) -> Method:
        """Return a method with the search's own defaults and single `settings` of its filter, named
        as in `FilterConfig.of`."""
        defaults = SEARCHES[search].defaults if search in SEARCHES else {}
        config = FilterConfig.of(**{**defaults, **settings})
        return cls(search, objective, filter=config)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], where: str = "") -> Method:
        """Return the inverse of `dataclasses.asdict`; what is not stated has the search's own
        default. Arguments and errors as of `config_of`."""
        search = values.get("search", "")
        base = cls.of(search) if search in SEARCHES else cls()
        return changed_config(base, values, where)

    @property
    def uses_voxels(self) -> bool:
        """Whether the objective observes voxels."""
        return self._objective.observes == "voxels"

    @property
    def uses_images(self) -> bool:
        """Whether the objective observes image features."""
        return self._objective.observes == "images"

    @property
    def _objective(self) -> ObjectiveSpec:
        return OBJECTIVES[self.objective]

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
        own = {**SEARCHES[self.search].settings, **self._objective.settings}
        return {
            "method": self.search,
            "objective": self.objective,
            "recover": self.recover,
            "both_ways": self.goes_back,
            "runs": self.n_runs,
            "filter": self.filter.settings,
            **{name: asdict(getattr(self, name)) for name in own},
        }
