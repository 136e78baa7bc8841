"""Settings of the voxel likelihood: weights and scales of its terms.

The error of a pose is the sum of the weighted terms over all cameras. With edge and silhouette
terms alone it is Song et al. eq. (16) with its sign corrected. "Tuned" means that a default was the
best of several over several seeds; "by hand" means that it was set once and not compared with
others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from apf.likelihood.terms import TERMS, TermSettings
from psfs.common.config import Config, natural, nonnegative, setting, with_parts

if TYPE_CHECKING:
    import numpy as np


#: Cost of a point at the place of its left or right partner, as a share of the greatest cost.
EXCHANGE_COST = 0.5


class KeypointConfig(Config):
    """The share of keypoints, and other points that cameras see, that the body misses."""

    weight: float = nonnegative(
        0.0,
        "Weight of the missed share in one camera's error.",
        "off, because there are no keypoints unless the user passes some",
    )
    room: int = natural(512, "Greatest number of sightings of a frame.", "33 points in 15 cameras")


@with_parts({term.name: term.settings for term in TERMS.values()})
class LikelihoodConfig(Config):
    """Settings of the voxel likelihood: the fields below, and one field per registered term, named
    as the term. For the likelihood of Song et al. set all weights except edge and silhouette to 0.
    """

    edge_weight: float = nonnegative(
        4.0,
        "Weight of the edge error, Song et al. eq. (14), who weigh it as the silhouette's.",
        "tuned",
        flag="--edge-weight",
        flag_help="weight of the edges, Song et al. eq. (14); or w2, Rymut",
    )
    silhouette_weight: float = nonnegative(
        1.0,
        "Weight of the silhouette error, Song et al. eq. (15).",
        "the unit of all weights",
        flag="--silhouette-weight",
        flag_help="of the silhouettes, eq. (15); or w1, Rymut",
    )
    surface_weight: float = nonnegative(
        2.0,
        "Weight of the share of surface voxels that no cone explains, counted once per camera.",
        "tuned with the colours of parts: the hull of few cameras fills the room between arms and "
        "trunk, and 4 draws arms into it",
        flag="--surface-weight",
        flag_help="weight of surface voxels left unexplained",
    )
    overlap_weight: float = nonnegative(
        1.0,
        "Weight of the depth by which parts intersect that must stay apart, counted once per "
        "camera.",
        "by hand",
        flag="--overlap-weight",
        flag_help="weight of parts lying in each other",
    )
    silhouette_recall_weight: float = nonnegative(
        0.0,
        "Weight of the share of the silhouettes that the body leaves uncovered (Rymut 2016 "
        "eq. 4.42); the limb search has one of its own, `LimbSearchConfig.least_recall`.",
        "off in the layers, which the surface's term serves for less work",
    )
    posture_prior_weight: float = nonnegative(
        0.02,
        "Weight of the squared distance from the posture prior's mean, the rest pose but for what "
        "rises with the arm, in the body's posture sigmas, counted once per camera; it determines "
        "the pose of hidden arms.",
        "tuned: 0.04 loses raised arms of low contrast, 0.01 loses more arms with 4 cameras",
    )
    n_points: int = natural(
        1024, "Number of surface voxels, evenly spread over all of them.", "by hand"
    )
    point_turns: int = natural(
        8,
        "Stride of these voxels in one layer; consecutive layers use different voxels.",
        "tuned: as accurate as 4",
    )
    foreground_join: bool = setting(
        True,
        "Whether to join the pictures' foreground to the silhouettes of the voxels; Song et al. "
        "use the voxels alone.",
        "one camera that takes an arm for background carves it out of the voxels, though it shows "
        "in the other pictures",
    )

    @property
    def weights(self) -> np.ndarray:
        """(4,) float32 weights of edge, silhouette, surface and overlap error."""
        import numpy as np

        return np.array(
            [self.edge_weight, self.silhouette_weight, self.surface_weight, self.overlap_weight],
            np.float32,
        )

    def term_settings(self, name: str) -> TermSettings:
        """Return the settings of a registered term."""
        return getattr(self, name)

    @property
    def terms(self) -> dict[str, TermSettings]:
        """Settings of the registered terms with a positive weight, by name."""
        every = {name: self.term_settings(name) for name in TERMS}
        return {name: settings for name, settings in every.items() if settings.weight > 0}
