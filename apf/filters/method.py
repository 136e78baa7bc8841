"""Settings of a search and its objective, as chosen by `apf track --method M --objective O`."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from typing import Any

from pydantic import model_validator

from apf.filters.config import FilterConfig
from apf.filters.searches import OBJECTIVES, SEARCHES, ObjectiveSpec, SirConfig, SwarmConfig
from apf.filters.term_weights import KEYPOINTS_ON
from apf.image_objective.config import FeatureConfig, ObjectiveConfig
from psfs.common.config import Config, part, setting, with_parts

#: Settings of single searches and objectives, by their field names in `Method`.
_OWN_SETTINGS = dict(
    chain(
        *(search.settings.items() for search in SEARCHES.values()),
        *(objective.settings.items() for objective in OBJECTIVES.values()),
    )
)


@with_parts(_OWN_SETTINGS)
class Method(Config):
    """A search, an objective and the settings of both; settings of others are ignored."""

    search: str = setting(
        "apf",
        "Search: annealed particle filter, particle swarm or particle filter.",
        "Song et al.",
        choices=SEARCHES,
    )
    objective: str = setting(
        "voxel",
        "Objective: the voxels' likelihood, keypoints alone, or a function of image features "
        "(Rymut 2016 eq. 4.46-4.50).",
        "Song et al.",
        choices=OBJECTIVES,
    )
    recover: bool = setting(
        True,
        "Whether to search again for a lost person; none of the papers does.",
        "docs/tracking.md",
    )
    both_ways: bool = setting(
        True,
        "Whether a take is also tracked backward, see `apf.tracking.two_way`; not with image "
        "features.",
        "docs/accuracy.md",
    )
    #: Settings of every search, and of the voxels' likelihood. A swarm compares errors of different
    #: iterations: with it, `point_turns` should be 1.
    filter: FilterConfig = part(FilterConfig)
    swarm: SwarmConfig = part(SwarmConfig)
    sir: SirConfig = part(SirConfig)
    image: ObjectiveConfig = part(ObjectiveConfig)
    features: FeatureConfig = part(FeatureConfig)

    @model_validator(mode="before")
    @classmethod
    def _agree(cls, values: dict[str, Any]) -> dict[str, Any]:
        """Set the kind of an image objective from `objective`; give keypoints their default weight
        if they are the only observation."""
        name = values.get("objective", "voxel")
        if name in OBJECTIVES and "image" in OBJECTIVES[name].settings:
            image = values.get("image") or ObjectiveConfig()
            return {**values, "image": image.replace(kind=name)}
        if name == "keypoints":
            config = values.get("filter") or FilterConfig()
            if not config.keypoints.weight > 0:
                return {**values, "filter": config.with_changes(**KEYPOINTS_ON)}
        return values

    @classmethod
    def create(cls, search: str = "apf", objective: str = "voxel", **settings: Any) -> Method:
        """Return a method with the defaults of the search, except for `settings` of its filter,
        named as in `FilterConfig.create`."""
        defaults = SEARCHES[search].defaults if search in SEARCHES else {}
        config = FilterConfig.create(**{**defaults, **settings})
        return cls(search=search, objective=objective, filter=config)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], where: str = "") -> Method:
        """Return the method that `to_dict` wrote as `values`; missing settings get the defaults of
        the search. For arguments and errors see `overlay`."""
        search = values.get("search", "")
        base = cls.create(search) if search in SEARCHES else cls()
        return base.overlay(values, where)

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
        """Whether a take is tracked forward and backward."""
        return self.both_ways and not self.uses_images

    @property
    def uses_keypoints(self) -> bool:
        """Whether keypoints have a weight, with another objective or alone."""
        return self.filter.keypoints.weight > 0

    def with_keypoints(self, n_sightings: int) -> Method:
        """Return the method with room for `n_sightings` keypoints in a frame; give keypoints their
        default weight if they have none."""
        room = max(self.filter.keypoints.room, n_sightings)
        weight = {} if self.uses_keypoints else KEYPOINTS_ON
        return self.replace(filter=self.filter.with_changes(keypoints_room=room, **weight))

    def describe(self) -> dict[str, Any]:
        """Return the settings that were used, for a track's provenance."""
        settings = {**SEARCHES[self.search].settings, **self._objective.settings}
        return {
            "method": self.search,
            "objective": self.objective,
            "recover": self.recover,
            "both_ways": self.goes_back,
            "filter": self.filter.settings,
            **{name: getattr(self, name).to_dict() for name in settings},
        }
