"""Every search over every objective: what `apf track --method M --objective O` chooses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Protocol

from apf.filters.annealed import AnnealedParticleFilter
from apf.filters.config import FilterConfig
from apf.filters.sir import SirConfig, SirParticleFilter
from apf.filters.swarm import ParticleSwarm, SwarmConfig
from apf.image_objective.features import FeatureConfig, features_for
from apf.image_objective.objective import KINDS, ObjectiveConfig, objective_for
from apf.likelihood.voxel import VoxelLikelihood
from apf.scene import Scene
from cl import Device, InputError, NumpyDevice
from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig
from psfs.cameras.names import listed
from psfs.config import ReconstructionConfig
from psfs.reconstructor import reconstructor_for
from psfs.sequence import Frame
from psfs.voxels.grid import VoxelGrid

SEARCHES = ("apf", "pso", "sir")
#: The voxels' likelihood, and the image objectives of Rymut 2016 eq. (4.46)-(4.50).
OBJECTIVES = ("voxel", *KINDS)

#: What a search changes in the defaults of FilterConfig.
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
    A swarm compares errors of different iterations: with it, `point_turns` should be 1.
    """

    search: str = "apf"
    objective: str = "voxel"
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
        if not self.uses_voxels:
            object.__setattr__(self, "image", replace(self.image, kind=self.objective))

    @classmethod
    def of(cls, search: str = "apf", objective: str = "voxel", **settings: Any) -> Method:
        """With the search's own defaults; `settings` are FilterConfig's."""
        config = FilterConfig(**{**SEARCH_DEFAULTS.get(search, {}), **settings})
        return cls(search, objective, config)

    @property
    def uses_voxels(self) -> bool:
        return self.objective == "voxel"

    def described(self) -> dict[str, Any]:
        """What was used, for a track's `config`."""
        used = {"method": self.search, "objective": self.objective, "filter": asdict(self.filter)}
        if self.search == "pso":
            used["swarm"] = asdict(self.swarm)
        if self.search == "sir":
            used["sir"] = asdict(self.sir)
        if not self.uses_voxels:
            used |= {"image": asdict(self.image), "features": asdict(self.features)}
        return used


def tracker_of(scene: Scene, method: Method, seeds: Sequence[int] | None = None) -> Any:
    """The tracker of `method` in the scene, or its twin; only the voxels' needs a grid.

    seeds: of the runs that it makes at once, see `batches`; the method's by default.
    """
    assert seeds is None or batches(scene.device, method), "only some trackers make several runs"
    scorer = scorer_of(scene, method, len(seeds or [0]))
    if isinstance(scene.device, NumpyDevice):
        return _twin(scene, scorer, method)
    if method.search == "pso":
        return ParticleSwarm(scene, scorer, method.filter, method.swarm)
    if method.search == "sir":
        return SirParticleFilter(scene, scorer, method.filter, method.sir)
    return AnnealedParticleFilter(scene, method.filter, scorer=scorer, seeds=seeds)


def batches(device: Device | NumpyDevice, method: Method) -> bool:
    """Whether the tracker of `method` can make several runs at once."""
    fits = method.search == "apf" and method.uses_voxels and not method.filter.remembers
    return fits and isinstance(device, Device)


def scorer_of(scene: Scene, method: Method, n_runs: int = 1) -> Any:
    """What the tracker of `method` searches with, or its twin; for so many runs at once."""
    if not method.uses_voxels:
        return objective_for(scene, method.filter.n_particles, method.image)
    if isinstance(scene.device, NumpyDevice):
        from apf.reference.base import NumpyVoxelLikelihood

        return NumpyVoxelLikelihood(scene, method.filter)
    return VoxelLikelihood(scene, method.filter, n_runs)


def _twin(scene: Scene, scorer: Any, method: Method) -> Any:
    from apf.reference.annealed import NumpyAnnealedParticleFilter
    from apf.reference.sir import NumpySirParticleFilter
    from apf.reference.swarm import NumpyParticleSwarm

    if method.search == "pso":
        return NumpyParticleSwarm(scene, scorer, method.filter, method.swarm)
    if method.search == "sir":
        return NumpySirParticleFilter(scene, scorer, method.filter, method.sir)
    return NumpyAnnealedParticleFilter(scene, method.filter, scorer=scorer)


class Footage(Protocol):
    """As much of a `Sequence` as says what its frames are."""

    @property
    def rig(self) -> CameraRig: ...

    @property
    def background(self) -> Background | None: ...

    @property
    def has_images(self) -> bool: ...


def observer_of(
    device: Device | NumpyDevice,
    sequence: Footage,
    grid: VoxelGrid | None,
    method: Method,
    reconstruction: ReconstructionConfig | None = None,
) -> Callable[[Frame], Any]:
    """What makes of a frame that which the tracker of `method` observes: voxels, or features.

    Sequences without pictures have only the silhouettes' outlines for edges.
    """
    rig, background = sequence.rig, sequence.background
    if method.uses_voxels:
        assert grid is not None, "voxels have a grid"
        return reconstructor_for(device, rig, grid, background, reconstruction, sparse=True)
    config = method.features
    if not sequence.has_images:
        config = replace(config, edges="outline")
    features = features_for(device, rig, background, config)

    def observe(frame: Frame) -> Any:
        features(frame)
        return features

    return observe
