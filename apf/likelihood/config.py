"""Settings of the voxels' likelihood: weights and scales of its terms.

The error of a pose is the sum over the cameras of the terms' weighted errors; with the weights of
edge and silhouette alone it is Song et al. eq. (16), its sign put right. "Tuned" says that a
default was the best of those tried on the synthetic walks (4 and 8 cameras) and the recordings at
hand, over several seeds; "by hand" that it was set once and not tried against others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from psfs.common.config import Config, part, setting
from psfs.voxels.config import ForegroundJoinConfig

if TYPE_CHECKING:
    import numpy as np


class PartColourConfig(Config):
    """Whether parts have their colours in the pictures: the mean, over what a camera sees of limbs
    and head, of how much likelier a colour is there than elsewhere on the person."""

    SOURCE: ClassVar = "by hand"

    weight: float = setting(
        4.0,
        "Weight of that mean, as a share of its bound, in one camera's error.",
        "tuned on the six suite sequences with `surface_weight`: 1 gains half as much, 8 nothing "
        "more",
        least=0,
    )
    n_colours: int = setting(
        48,
        "Number of colours of the palette.",
        "tuned: a fixed grid of 256 tells skin from a red shirt worse",
        least=2,
        most=63,
    )
    decay: float = setting(
        0.97,
        "Share that histograms keep from frame to frame: about a second at 30 frames/s.",
        least=0,
        below=1,
    )
    bound: float = setting(
        2.0,
        "Bound of log ratios: a colour never seen on a part is not impossible.",
        unit="nats",
        above=0,
    )
    rare: float = setting(0.004, "Likelihood of a code on a part that never showed it.", above=0)
    least_samples: float = setting(
        60.0,
        "Number of samples from which a part's ratios count in full: of fewer they say little.",
        above=0,
    )
    least_pixels: int = setting(
        500, "Number of pixels of a person from which a palette is made.", unit="px", above=0
    )


class ContourConfig(Config):
    """How much the pictures change across the outlines of limbs and head, the mean over what a
    camera sees of them."""

    weight: float = setting(
        8.0,
        "Weight of what that mean lacks of 1 in one camera's error.",
        "tuned on the six suite sequences: 4 to 12 differ little",
        least=0,
    )
    contrast: float = setting(
        7.5,
        "Change of the picture that counts in full.",
        "tuned: 4 does as well, 12 worse",
        "grey levels per px",
        above=0,
        below=255,
    )


class MotionPriorConfig(Config):
    """The mean squared change since the last frame, in the body's sigmas."""

    weight: float = setting(
        0.0,
        "Weight of that mean in one camera's error.",
        "off: the particles' noise bounds the change anyway",
        least=0,
    )
    scale: float = setting(
        1.0,
        "Change at 60 frames/s that counts as one.",
        "by definition of the sigmas",
        "of the body's sigmas",
        above=0,
    )


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


class LikelihoodConfig(Config):
    """What the voxels' likelihood is made of. All weights but those of edge and silhouette are 0
    for Song et al.'s likelihood alone."""

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
    part_colour: PartColourConfig = part(PartColourConfig, "The parts' colours in the pictures.")
    contour: ContourConfig = part(ContourConfig, "The parts' contours in the pictures.")
    motion_prior: MotionPriorConfig = part(MotionPriorConfig, "The change since the last frame.")

    @property
    def weights(self) -> np.ndarray:
        """(4,) float32 weights of edge, silhouette, surface and overlap error."""
        import numpy as np

        return np.array(
            [self.edge_weight, self.silhouette_weight, self.surface_weight, self.overlap_weight],
            np.float32,
        )

    @property
    def depends_on_track(self) -> bool:
        """Whether there are terms that depend on the track so far."""
        return self.motion_prior.weight > 0
