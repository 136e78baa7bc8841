"""Settings of the silhouettes, in parts; shared by the kernels and their NumPy twins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from psfs.background.config import (
    BackgroundConfig,
    EvidenceConfig,
    LightConfig,
)
from psfs.common.config import Config, fraction, natural, nonnegative, part, setting

#: Source of the defaults that name no other one.
_TUNED = "tuned with true masks"


@dataclass(frozen=True)
class PixelModel:
    """Numbers of a pixel's colour that the kernels and their twins share."""

    floor_low: float = 0.15
    """Least light factor of a shadow on the floor."""
    floor_std: float = 0.03
    """Its standard deviation between cameras that see the same shadow."""
    floor_lit_std: float = 0.025
    """The same where the others see the floor lit."""
    floor_depth: float = 0.45
    """Its standard deviation around 1: shoes are darker than shadows."""
    floor_enough: int = 4
    """Number of other cameras that see the floor from which on two must agree on a shadow."""
    floor_lit: float = 0.9
    """Light factor above which the floor passes for lit, whatever the others see."""
    floor_fully_lit: float = 0.997
    """Light factor above which it is not shaded at all: light has steps of 1/127."""
    floor_nearest: float = 9.0
    """Squared distance of what may still be floor in shadow: 3 sigma."""
    rim_share: float = 0.4
    """Share of the person's luma up to which a pixel of the rim may be background."""
    rim_cost: float = 4.0
    """Cost in nats of taking it for that."""
    rim_chroma_noise: float = 0.67
    """Its chroma's noise as a share of the luma's, the green channel's."""
    contrast: float = 20.0
    """Difference of luma, grey levels, that takes three quarters of a pixel's weight in the
    smoothing."""


PIXEL = PixelModel()


class FloorConfig(Config):
    """Detection of shadows on the floor, which look alike in all cameras, so that arms and shoes in
    front of a floor of their colour are not mistaken for shadow."""

    SOURCE: ClassVar = _TUNED

    on: bool = setting(True, "Whether to detect shadows on the floor; Song et al. do not.")
    height: float = setting(
        0.0, "Height of the floor in the world of the calibration.", "by definition", "m"
    )

    @property
    def seen_height(self) -> float:
        """The floor's height, m; NaN if shadows are not detected."""
        return self.height if self.on else float("nan")


class RimConfig(Config):
    """The silhouette's rim, where the person's colour and the background's are mixed. Without this
    model, mixed pixels, which fit no background, would widen silhouettes. Videos store chroma at
    half the resolution, so it bleeds farther than luma: any share of it may be the person's."""

    SOURCE: ClassVar = _TUNED

    on: bool = setting(True, "Whether to model mixed pixels at the rim; Song et al. do not.")


#: Width, px, of a span, as high as a cell: evidence is smoothed only in spans with foreground in
#: them or in a neighbouring span.
SPAN = 16


class EvidenceSmoothingConfig(Config):
    """Contrast-sensitive smoothing: near foreground a pixel's evidence is the mean over the pixels
    around it of similar luma, so that silhouettes end at edges of the picture."""

    SOURCE: ClassVar = _TUNED

    reach: int = setting(
        2,
        "Distance to all sides up to which pixels count. With 0 each pixel speaks for itself, away "
        "from foreground, too, where it else is the sum of 3x3 (Song et al. eq. 1-2 have no "
        "neighbours).",
        unit="px",
        least=0,
        most=2,
    )

    @property
    def sum_reach(self) -> int:
        """Radius, px, of the square over which log ratios are summed before the smoothing."""
        return min(self.reach, 1)


class AppearanceConfig(Config):
    """The person's appearance, fitted to each reconstructed frame for the next one, see
    `psfs.silhouettes.appearance`. Song et al. 2.2.1 ask for such a foreground."""

    SOURCE: ClassVar = _TUNED

    learn: bool = setting(
        True, "Whether the person's colours and location are estimated from the previous frames."
    )
    look_again: bool = setting(
        True,
        "Whether a frame after a gap is segmented twice, the second time with the person's "
        "location "
        "from the first.",
    )
    first_looks: int = natural(
        4,
        "Number of repetitions of the first frame's segmentation, each with the appearance "
        "model of "
        "the previous one.",
        "of a grey person on grey, 19 % of the silhouettes are missing after one, 10 % after four",
    )
    location_inside: float = setting(
        0.98,
        "Prior P(F = 1) of a pixel well within the person's silhouette of the frame before, in "
        "place of `foreground_prior`.",
        above=0,
        below=1,
    )
    location_outside: float = setting(
        0.3,
        "Prior P(F = 1) of a pixel well outside the person's silhouette of the frame before.",
        above=0,
        below=1,
    )
    reach: int = nonnegative(
        2,
        "Distance over which the location prior is blurred, for the way to the next frame: 10 px "
        "either way.",
        unit="cells",
    )
    max_gap: int = nonnegative(
        3, "Number of frames after which the estimated location is too old.", unit="frames"
    )
    keep: float = fraction(
        0.9, "Share of the colour histogram's weight that a frame leaves of the earlier ones."
    )
    uniform: float = fraction(
        0.1,
        "Weight of the uniform foreground beside the histogram: colours never seen stay possible.",
    )
    prior_samples: float = nonnegative(
        200.0, "Number of samples that the histogram begins with, spread over all colours."
    )
    most: float = fraction(
        0.4,
        "Share of the cells that look like the person above which a frame does not update the "
        "model.",
    )
    min_surface: int = nonnegative(
        64, "Number of surface voxels below which the frame shows no person.", unit="voxels"
    )


class SilhouetteConfig(Config):
    """The silhouette likelihood map (Song et al. eq. 1-2) and its evidence."""

    background: BackgroundConfig = part(BackgroundConfig)
    light: LightConfig = part(LightConfig)
    floor: FloorConfig = part(FloorConfig)
    rim: RimConfig = part(RimConfig)
    smoothing: EvidenceSmoothingConfig = part(EvidenceSmoothingConfig)
    evidence: EvidenceConfig = part(EvidenceConfig)
    appearance: AppearanceConfig = part(AppearanceConfig)

    def without_memory(self) -> SilhouetteConfig:
        """Return these settings with everything off that carries over from one frame to the
        next."""
        return self.replace(appearance=AppearanceConfig(learn=False))
