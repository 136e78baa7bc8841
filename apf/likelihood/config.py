"""Settings of the voxels' likelihood: weights and scales of its terms.

The error of a pose is the sum over the cameras of the terms' weighted errors; with the weights of
edge and silhouette alone it is Song et al. eq. (16), its sign put right. "Tuned" says that a
default was the best of those tried on the synthetic walks (4 and 8 cameras) and the recordings at
hand, over several seeds; "by hand" that it was set once and not tried against others.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from psfs.common.ranges import check_range
from psfs.voxels.config import ForegroundJoinConfig


@dataclass(frozen=True)
class PartColourConfig:
    """Whether parts have their colours in the pictures: the mean, over what a camera sees of limbs
    and head, of how much likelier a colour is there than elsewhere on the person."""

    weight: float = 4.0
    """Of that mean, as a share of its bound, in one camera's error. Tuned on the six suite
    sequences with `surface_weight`: 1 gains half as much, 8 nothing more."""
    n_colours: int = 48
    """Colours of the palette, at most 63. Tuned: a fixed grid of 256 tells skin from a red shirt
    worse."""
    decay: float = 0.97
    """What histograms keep from frame to frame, in [0, 1): about a second at 30 frames/s. By
    hand."""
    bound: float = 2.0
    """Log ratios are cut there: a colour never seen on a part is not impossible. By hand."""
    rare: float = 0.004
    """Likelihood of a code on a part that never showed it. By hand."""
    least_samples: float = 60.0
    """Samples from which a part's ratios count in full. By hand: of fewer they say little."""
    least_pixels: int = 500
    """Pixels of a person from which a palette is made. By hand."""

    def __post_init__(self) -> None:
        check_range("part_colour_weight", self.weight, 0, ends=True)
        check_range("part_colour_n_colours", self.n_colours, 2, 63, ends=True)
        check_range("part_colour_decay", self.decay, 0, 1, ends=True)
        for name in ("bound", "rare", "least_samples", "least_pixels"):
            check_range(f"part_colour_{name}", getattr(self, name), 0)


@dataclass(frozen=True)
class ContourConfig:
    """How much the pictures change across the outlines of limbs and head, the mean over what a
    camera sees of them."""

    weight: float = 8.0
    """Of what that mean lacks of 1, in one camera's error. Tuned on the six suite sequences: 4 to
    12 differ little."""
    contrast: float = 7.5
    """Grey values per pixel that count in full. Tuned: 4 does as well, 12 worse."""

    def __post_init__(self) -> None:
        check_range("contour_weight", self.weight, 0, ends=True)
        check_range("contour_contrast", self.contrast, 0, 255)


@dataclass(frozen=True)
class MotionPriorConfig:
    """The mean squared change since the last frame, in the body's sigmas."""

    weight: float = 0.0
    """Of the mean, in one camera's error. Off: the particles' noise bounds the change anyway."""
    scale: float = 1.0
    """Sigmas of the body, at 60 frames/s, that count as one. By definition of the sigmas."""

    def __post_init__(self) -> None:
        check_range("motion_prior_weight", self.weight, 0, ends=True)
        check_range("motion_prior_scale", self.scale, 0)


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
class LikelihoodConfig:
    """What the voxels' likelihood is made of. All weights but those of edge and silhouette are 0
    for Song et al.'s likelihood alone."""

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
    part_colour: PartColourConfig = field(default_factory=PartColourConfig)
    """What colours parts have in the pictures,"""
    contour: ContourConfig = field(default_factory=ContourConfig)
    """and what contours."""
    motion_prior: MotionPriorConfig = field(default_factory=MotionPriorConfig)

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

    @property
    def depends_on_track(self) -> bool:
        """Whether there are terms that depend on the track so far."""
        return self.motion_prior.weight > 0
