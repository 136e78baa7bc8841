"""Every search over every objective: what `apf track --method M --objective O` chooses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal, get_args

from pydantic import model_validator

from apf.filters.config import KEYPOINTS_ON, FilterConfig
from apf.image_objective.config import OBJECTIVE_KINDS, FeatureConfig, ObjectiveConfig
from psfs.common.config import Config, part, setting

Search = Literal["apf", "pso", "sir"]
Objective = Literal["voxel", "keypoints", "ws", "sp", "aows", "aosp", "posp"]
SEARCHES: tuple[str, ...] = get_args(Search)
#: The voxels' likelihood, keypoints alone, and the image objectives of Rymut 2016 eq.
#: (4.46)-(4.50).
OBJECTIVES: tuple[str, ...] = get_args(Objective)

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
    cognitive: float = setting(
        1.2,
        "Pull c1 of a particle's own best.",
        least=0,
        flag="--cognitive",
        flag_help="pso: pull of a particle's own best",
    )
    social: float = setting(
        1.2,
        "Pull c2 of the best of all.",
        least=0,
        flag="--social",
        flag_help="pso: pull of the best of all",
    )


class SirConfig(Config):
    """The observation model of a particle filter with resampling, Rymut 2016 eq. (2.42)."""

    sigma_z: float = setting(
        0.0,
        "Standard deviation of 1 - f; 0 finds it anew in each frame, such that the effective "
        "sample size is `SearchConfig.first_survival` of the particles.",
        "Rymut does not state his",
        least=0,
        flag="--sigma-z",
        flag_help="sir: of Rymut eq. (2.42), 0 for one found in each frame",
    )

    @property
    def beta(self) -> float:
        """The exponent of exp(-(1 - f)^2), 0 for one to be found."""
        return self.sigma_z**-2 if self.sigma_z > 0 else 0.0


class Method(Config):
    """A search, an objective and the settings of both; those of others are not looked at."""

    search: Search = setting(
        "apf", "Search: annealed particle filter, particle swarm or particle filter.", "Song et al."
    )
    objective: Objective = setting(
        "voxel",
        "What is searched for: the voxels' likelihood, keypoints alone, or a function of image "
        "features (Rymut 2016 eq. 4.46-4.50).",
        "Song et al.",
    )
    recover: bool = setting(
        True,
        "Whether a person who was lost is looked for again, which no paper does.",
        "docs/tracking.md",
    )
    both_ways: bool = setting(
        True,
        "Whether a take is tracked back, too, see `apf.tracking.two_way`; image features are not.",
        "docs/accuracy.md",
    )
    runs: int = setting(
        2, "Number of runs, each both ways, that make a track then.", "docs/accuracy.md", least=1
    )
    filter: FilterConfig = part(
        FilterConfig,
        "Settings of every search, and of the voxels' likelihood. A swarm compares errors of "
        "different iterations: with it, `point_turns` should be 1.",
    )
    swarm: SwarmConfig = part(SwarmConfig, "Settings of the particle swarm.")
    sir: SirConfig = part(SirConfig, "Settings of the particle filter with resampling.")
    image: ObjectiveConfig = part(ObjectiveConfig, "Settings of the objectives over images.")
    features: FeatureConfig = part(FeatureConfig, "Which image features are looked at.")

    @model_validator(mode="before")
    @classmethod
    def _agree(cls, values: dict[str, Any]) -> dict[str, Any]:
        """Let image objectives be of the kind that the objective names, and keypoints alone have a
        weight."""
        objective = values.get("objective", "voxel")
        if objective in OBJECTIVE_KINDS:
            image = values.get("image") or ObjectiveConfig()
            return {**values, "image": image.replace(kind=objective)}
        if objective == "keypoints":
            config = values.get("filter") or FilterConfig()
            if not config.keypoints.weight > 0:
                return {**values, "filter": config.changed(**KEYPOINTS_ON)}
        return values

    @classmethod
    def of(cls, search: str = "apf", objective: str = "voxel", **settings: Any) -> Method:
        """Return a method with the search's own defaults and single `settings` of its filter, named
        as in `FilterConfig.of`."""
        config = FilterConfig.of(**{**SEARCH_DEFAULTS.get(search, {}), **settings})
        return cls().replace(search=search, objective=objective, filter=config)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], where: str = "") -> Method:
        """Return the inverse of `to_dict`; what is not stated has the search's own default."""
        search = values.get("search")
        base = cls.of(search) if search in SEARCHES else cls()
        return base.overlaid(values, where)

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
        return self.replace(filter=self.filter.changed(keypoints_room=room, **weight))

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
            used["swarm"] = self.swarm.to_dict()
        if self.search == "sir":
            used["sir"] = self.sir.to_dict()
        if self.uses_images:
            used |= {"image": self.image.to_dict(), "features": self.features.to_dict()}
        return used
