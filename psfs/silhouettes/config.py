"""Parameters of the silhouettes, in parts; shared by the kernels and their NumPy twins."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from psfs.background.config import (
    AdaptationConfig,
    BackgroundConfig,
    ChromaKeyConfig,
    EvidenceConfig,
)
from psfs.common.ranges import check_range


@dataclass(frozen=True)
class FloorConfig:
    """Shadows on the floor, which are the same for all cameras: arms and shoes before a floor of
    their colour are not mistaken for shaded floor.

    The defaults were tuned on synthetic walks with true masks and on a real person on a green
    carpet.
    """

    on: bool = True
    """Whether the floor has rules of its own; Song et al. know no floor."""
    height: float = 0.0
    """Height of the floor, m, in the world of the calibration."""
    shadow_low: float = 0.15
    """Least light factor of a shadow that falls on the floor."""
    shadow_width: float = 0.03
    """Standard deviation of the light factor between cameras that see the same shadow."""
    lit_width: float = 0.025
    """The same where the others see the floor lit: it is lit for all."""
    enough: int = 4
    """Other cameras with a say of which two must agree on a shadow; of fewer one is enough."""
    lit: float = 0.9
    """Light factor above which the floor passes for lit, whatever the others see."""
    shadow_depth: float = 0.45
    """Standard deviation of a shadow's light factor around 1: shoes are darker than shadows."""
    nearest: float = 9.0
    """Squared distance, in standard deviations of the noise, of what may still be floor in shadow:
    the usual 3 sigma."""
    fully_lit: float = 0.997
    """Light on the floor above which it is not shaded at all; light has steps of 1 / 127."""

    def __post_init__(self) -> None:
        for name in ("shadow_width", "lit_width", "shadow_depth"):
            check_range(f"the floor's {name}", getattr(self, name), 0)
        check_range("the floor's enough", self.enough, 2, ends=True)


@dataclass(frozen=True)
class RimConfig:
    """The silhouette's rim, where the person's colour and the background's are mixed. Without it
    mixed pixels, which fit no background, would widen silhouettes. Videos keep chroma at half the
    resolution, so it bleeds farther than luma: any share of it may be the person's. Tuned on
    synthetic people with true masks."""

    on: bool = True
    """Whether there is a rim; Song et al. know none."""
    share: float = 0.4
    """A pixel of the rim is background up to that share of the person's luma..."""
    cost: float = 4.0
    """...at the price of so many nats."""
    chroma_noise: float = 0.67
    """Standard deviation of the chroma's noise as a share of the luma's, which is the green
    channel's."""

    def __post_init__(self) -> None:
        check_range("the rim's share", self.share, 0, 1)
        check_range("the rim's cost", self.cost, 0)
        check_range("the rim's chroma_noise", self.chroma_noise, 0)


#: Width, px, of the parts of the picture, as high as a cell, in which or beside which foreground is
#: looked for before evidence is smoothed.
SPAN = 16


@dataclass(frozen=True)
class EvidenceSmoothingConfig:
    """Contrast-sensitive smoothing: near foreground a pixel's evidence is that of the pixels around
    it that look like it, so silhouettes end where the picture has edges. Tuned on synthetic people
    with true masks; a reach of 1 and a contrast of 1000 is the plain mean over 3x3 pixels."""

    reach: int = 2
    """Pixels to all sides that count: 0 to 2. With 0 each pixel speaks for itself, away from
    foreground, too, where it else is the sum of 3x3 (Song et al. eq. 1-2 have no neighbours)."""
    contrast: float = 20.0
    """Difference of luma, grey levels, that takes three quarters of a pixel's weight."""

    def __post_init__(self) -> None:
        check_range("the smoothing's reach", self.reach, 0, 2, ends=True)
        check_range("the smoothing's contrast", self.contrast, 0)

    @property
    def sum_reach(self) -> int:
        """Pixels to all sides whose log ratios are summed before anything is smoothed."""
        return min(self.reach, 1)


@dataclass(frozen=True)
class AppearanceConfig:
    """What the reconstructed person teaches for the next frame, see `psfs.silhouettes.appearance`.

    Song et al. 2.2.1 ask for a learnt foreground; the defaults were tuned on synthetic walks with
    true masks and on a real person on a green carpet.
    """

    learn: bool = True
    """Learn the person's colours and location."""
    look_again: bool = True
    """Work twice on a frame that does not follow shortly after the one before, the second time
    knowing the person's location; else only on the very first one, which takes half the time."""
    location_inside: float = 0.98
    """Location prior: P(F = 1) of a pixel well within the person's silhouette of the frame before,
    instead of `foreground_prior`."""
    location_outside: float = 0.3
    """Location prior: P(F = 1) of a pixel well outside."""
    reach: int = 2
    """Cells around a pixel over which the location prior is blurred, for the way to the next
    frame: 10 px either way."""
    max_gap: int = 3
    """Frames after which what was learnt of the location is too old."""
    keep: float = 0.9
    """Share of the colour histogram's weight that a frame leaves of the earlier ones."""
    uniform: float = 0.1
    """Weight of the uniform foreground beside the histogram: colours never seen stay possible."""
    prior_samples: float = 200.0
    """Samples that the histogram begins with, spread over all colours."""
    most: float = 0.4
    """Frames in which more than this share of the cells look like the person are not learnt
    from."""
    min_surface: int = 64
    """Surface voxels below which nobody is there."""

    def __post_init__(self) -> None:
        for name in ("location_inside", "location_outside"):
            check_range(name, getattr(self, name), 0, 1)


@dataclass(frozen=True)
class SilhouetteConfig:
    """Parameters of the silhouette likelihood map (Song et al. eq. 1-2) and of its evidence."""

    background: BackgroundConfig = field(default_factory=BackgroundConfig)
    """The density of the background's colours."""
    floor: FloorConfig = field(default_factory=FloorConfig)
    """Shadows on the floor."""
    rim: RimConfig = field(default_factory=RimConfig)
    """Mixed pixels."""
    smoothing: EvidenceSmoothingConfig = field(default_factory=EvidenceSmoothingConfig)
    """How pixels learn from those around them."""
    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)
    """From log ratios to evidence, and its limits."""
    appearance: AppearanceConfig = field(default_factory=AppearanceConfig)
    """What is learnt of the person for the next frame."""
    adaptation: AdaptationConfig = field(default_factory=AdaptationConfig)
    """How the background follows the light."""
    chroma_key: ChromaKeyConfig = field(default_factory=ChromaKeyConfig)
    """The density of a screen's colours, where the background is one."""

    def without_memory(self) -> SilhouetteConfig:
        """Return these settings, but for that nothing is learnt from one frame for the next."""
        return replace(self, appearance=AppearanceConfig(learn=False))
