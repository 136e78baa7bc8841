"""Settings of the voxels' likelihood: weights and scales of its terms.

The error of a pose is the sum over the cameras of the terms' weighted errors; with the weights of
edge and silhouette alone it is Song et al. eq. (16), its sign put right. "Tuned" says that a
default was the best of those tried on the synthetic walks (4 and 8 cameras) and the recordings at
hand, over several seeds; "by hand" that it was set once and not tried against others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from apf.likelihood.terms import TERMS, TermSettings
from apf.likelihood.terms.contour import ContourConfig
from apf.likelihood.terms.motion_prior import MotionPriorConfig
from apf.likelihood.terms.part_colour import PartColourConfig
from psfs.common.config import Config, part, setting, with_parts
from psfs.voxels.config import ForegroundJoinConfig

if TYPE_CHECKING:
    import numpy as np


__all__ = [
    "ContourConfig",
    "KeypointConfig",
    "LikelihoodConfig",
    "MotionPriorConfig",
    "PartColourConfig",
    "ReprojectionConfig",
    "SurfaceSamplesConfig",
]


class KeypointConfig(Config):
    """The share of keypoints, and other points that cameras see, that the body misses."""

    SOURCE: ClassVar = "by hand"

    weight: float = setting(
        0.0,
        "Weight of that share in one camera's error.",
        "off: there are no keypoints unless somebody brings them",
        least=0,
    )
    reach: float = setting(
        5.0,
        "Distance at which a point is half missed (Geman & McClure 1987): one that is quite wrong "
        "costs no more than 1.",
        unit="standard deviations",
        above=0,
    )
    exchange: float = setting(
        0.5,
        "Cost of taking left for right, as a share of a point that is quite missed.",
        least=0,
        most=1,
    )
    room: int = setting(
        512, "Number of sightings that a frame may have.", "33 points in 15 cameras", least=1
    )


class ReprojectionConfig(Config):
    """How cones are compared with the reprojected voxels, by edges and silhouettes."""

    sample_spacing: float = setting(
        0.06,
        "Distance between the samples on a cone.",
        "tuned: as accurate as 0.05, in less time",
        "m",
        above=0,
    )
    foreground_join: ForegroundJoinConfig = part(
        ForegroundJoinConfig, "What of the pictures' foreground joins the voxels' silhouettes."
    )


class SurfaceSamplesConfig(Config):
    """Which of the surface voxels are looked at."""

    n_points: int = setting(
        1024, "Number of surface voxels, evenly spread over all of them.", "by hand", least=1
    )
    point_turns: int = setting(
        8,
        "Number of layers that take turns: each looks at every such voxel of these.",
        "tuned: as accurate as 4",
        least=1,
    )


@with_parts({term.name: term.settings for term in TERMS.values()})
class LikelihoodConfig(Config):
    """What the voxels' likelihood is made of: what is here, and a field for the settings of every
    registered term, by its name. All weights but those of edge and silhouette are 0 for Song et
    al.'s likelihood alone."""

    edge_weight: float = setting(
        4.0,
        "Weight of the edge error, Song et al. eq. (14), who weigh it as the silhouette's.",
        "tuned on nine sequences; it was 2 before",
        least=0,
        flag="--edge-weight",
        flag_help="weight of the edges, Song et al. eq. (14); or w2, Rymut",
    )
    silhouette_weight: float = setting(
        1.0,
        "Weight of the silhouette error, Song et al. eq. (15).",
        "the unit of all weights",
        least=0,
        flag="--silhouette-weight",
        flag_help="of the silhouettes, eq. (15); or w1, Rymut",
    )
    surface_weight: float = setting(
        2.0,
        "Weight of the share of surface voxels that no cone explains, counted once per camera.",
        "tuned with the colours of parts: the hull of few cameras fills the room between arms and "
        "trunk, and 4 draws arms into it",
        least=0,
        flag="--surface-weight",
        flag_help="weight of surface voxels left unexplained",
    )
    overlap_weight: float = setting(
        1.0,
        "Weight of how deep parts lie in each other that must not, counted once per camera.",
        "by hand",
        least=0,
        flag="--overlap-weight",
        flag_help="weight of parts lying in each other",
    )
    silhouette_recall_weight: float = setting(
        0.0,
        "Weight of the share of the silhouettes that the body leaves uncovered (Rymut 2016 "
        "eq. 4.42); the limb search has one of its own, `LimbSearchConfig.least_recall`.",
        "off in the layers, which the surface's term serves for less work",
        least=0,
    )
    posture_prior_weight: float = setting(
        0.02,
        "Weight of the squared distance from the rest pose, in the body's posture sigmas, counted "
        "once per camera: it decides where an arm is that nothing shows.",
        "tuned: 0.04 loses raised arms that the pictures show faintly, 0.01 more arms in 4 cameras",
        least=0,
    )
    surface_scale: float = setting(
        0.05,
        "Distance at which a surface voxel is half unexplained (Geman & McClure 1987).",
        "by hand: about as far as hulls of few cameras and cones differ from flesh",
        "m",
        above=0,
    )
    samples: SurfaceSamplesConfig = part(
        SurfaceSamplesConfig, "Which of the surface voxels the surface's term looks at."
    )
    reprojection: ReprojectionConfig = part(
        ReprojectionConfig, "What the terms of edge and silhouette look at."
    )

    @property
    def weights(self) -> np.ndarray:
        """(4,) float32 weights of edge, silhouette, surface and overlap error."""
        import numpy as np

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
