"""Settings of the voxels' likelihood: weights and scales of its terms.

The error of a pose is the sum over the cameras of the terms' weighted errors; with the weights of
edge and silhouette alone it is Song et al. eq. (16), its sign put right. "Tuned" says that a
default was the best of those tried on the synthetic walks (4 and 8 cameras) and the recordings at
hand, over several seeds; "by hand" that it was set once and not tried against others.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from apf.likelihood.terms import TERMS, TermSettings
from apf.likelihood.terms.contour import ContourConfig
from apf.likelihood.terms.motion_prior import MotionPriorConfig
from apf.likelihood.terms.part_colour import PartColourConfig
from psfs.common.configs import with_settings
from psfs.common.ranges import check_range
from psfs.voxels.config import ForegroundJoinConfig

__all__ = [
    "ContourConfig",
    "KeypointConfig",
    "LikelihoodConfig",
    "MotionPriorConfig",
    "PartColourConfig",
    "ReprojectionConfig",
    "SurfaceSamplesConfig",
]


@dataclass(frozen=True)
class KeypointConfig:
    """The share of keypoints, and other points that cameras see, that the body misses."""

    weight: float = 0.0
    """Of the share, in one camera's error. Off: there are none unless somebody brings them."""
    reach: float = 5.0
    """Deviations at which a point is half missed (Geman & McClure 1987): one that is quite wrong
    costs no more than 1. By hand."""
    exchange: float = 0.5
    """What it costs that left was taken for right, of a point that is quite missed. By hand."""
    room: int = 512
    """Sightings that a frame may have: 33 points in 15 cameras."""

    def __post_init__(self) -> None:
        check_range("keypoints_weight", self.weight, 0, ends=True)
        check_range("keypoints_reach", self.reach, 0)
        check_range("keypoints_exchange", self.exchange, 0, 1, ends=True)
        check_range("keypoints_room", self.room, 1, ends=True)


@dataclass(frozen=True)
class ReprojectionConfig:
    """How cones are compared with the reprojected voxels, by edges and silhouettes."""

    sample_spacing: float = 0.06
    """m between the samples on a cone. Tuned: as accurate as 0.05, in less time."""
    foreground_join: ForegroundJoinConfig = field(default_factory=ForegroundJoinConfig)

    def __post_init__(self) -> None:
        check_range("sample_spacing", self.sample_spacing, 0)


@dataclass(frozen=True)
class SurfaceSamplesConfig:
    """Which of the surface voxels are looked at."""

    n_points: int = 1024
    """So many, evenly spread over all of them. By hand."""
    point_turns: int = 8
    """Each layer looks at every `point_turns`-th of these, in turn. Tuned: as accurate as 4."""

    def __post_init__(self) -> None:
        for name in ("n_points", "point_turns"):
            check_range(name, getattr(self, name), 1, ends=True)


@dataclass(frozen=True)
@with_settings({term.name: term.settings for term in TERMS.values()})
class LikelihoodConfig:
    """What the voxels' likelihood is made of: what is here, and a field for the settings of every
    registered term, by its name. All weights but those of edge and silhouette are 0 for Song et
    al.'s likelihood alone."""

    edge_weight: float = 4.0
    """Of the edge error, Song et al. eq. (14), who weigh it as the silhouette's. Tuned on nine
    sequences; it was 2 before."""
    silhouette_weight: float = 1.0
    """Of the silhouette error, Song et al. eq. (15): the unit of all weights."""
    surface_weight: float = 2.0
    """Of the share of surface voxels that no cone explains, counted once per camera. Tuned with the
    colours of parts: the hull of few cameras fills the room between arms and trunk, and 4 draws
    arms into it."""
    overlap_weight: float = 1.0
    """Of how deep parts lie in each other that must not, counted once per camera. By hand."""
    silhouette_recall_weight: float = 0.0
    """Of the share of the silhouettes that the body leaves uncovered (Rymut 2016 eq. 4.42). Off in
    the layers, which the surface's term serves for less work; see
    `LimbSearchConfig.least_recall`."""
    posture_prior_weight: float = 0.02
    """Of the squared distance from the rest pose, in the body's posture sigmas, counted once per
    camera: it decides where an arm is that nothing shows. Tuned: 0.04 loses raised arms that the
    pictures show faintly, 0.01 more arms in 4 cameras."""
    surface_scale: float = 0.05
    """m, distance at which a surface voxel is half unexplained (Geman & McClure 1987). By hand:
    about as far as hulls of few cameras and cones differ from flesh."""
    samples: SurfaceSamplesConfig = field(default_factory=SurfaceSamplesConfig)
    """Which of the surface voxels that term looks at."""
    reprojection: ReprojectionConfig = field(default_factory=ReprojectionConfig)
    """What the terms of edge and silhouette look at."""

    def __post_init__(self) -> None:
        check_range("surface_scale", self.surface_scale, 0)
        weights = (
            "edge_weight", "silhouette_weight", "surface_weight", "overlap_weight",
            "silhouette_recall_weight", "posture_prior_weight",
        )  # fmt: skip
        for name in weights:
            check_range(name, getattr(self, name), 0, ends=True)

    @property
    def weights(self) -> np.ndarray:
        """(4,) float32 weights of edge, silhouette, surface and overlap error."""
        return np.array(
            [self.edge_weight, self.silhouette_weight, self.surface_weight, self.overlap_weight],
            np.float32,
        )

    def of_term(self, name: str) -> TermSettings:
        """Return the settings of a registered term."""
        settings: TermSettings = getattr(self, name)
        return settings

    @property
    def terms(self) -> dict[str, TermSettings]:
        """The settings of the registered terms that have a weight, by name."""
        every = {name: self.of_term(name) for name in TERMS}
        return {name: settings for name, settings in every.items() if settings.weight > 0}

    @property
    def track_terms(self) -> list[str]:
        """Names of the terms with a weight that depend on the track so far."""
        return [name for name in self.terms if TERMS[name].depends_on_track]
