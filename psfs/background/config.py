"""Parameters of the background: how it is learnt, how it looks, what it says of a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cl import InputError
from psfs.common.ranges import check_range


@dataclass(frozen=True)
class PlateConfig:
    """How the empty scene is learnt from pictures, see `psfs.background.gaussian`."""

    std_floor: float = 2.0
    """Least standard deviation, grey levels: a noiseless background must not make N(I; mu, sigma)
    explode. Set by hand."""
    prior_std: float = 6.0
    """Standard deviation, grey levels, believed in before any frame is seen; set by hand."""
    prior_frames: float = 2.0
    """Weight of `prior_std`, in frames. A single picture as background thus gets 4.9 grey levels;
    set by hand."""
    clip: float = 3.0
    """Standard deviations beyond which a value is left out of the mean: the usual 3 sigma."""
    samples: int = 25
    """Frames that a background is learnt from when the scene is never empty: enough for a median;
    set by hand."""
    mixture_samples: int = 50
    """Frames that mixtures of Gaussians are learnt from when the scene is never empty; set by
    hand."""
    mixture_rate: float = 0.0005
    """alpha of Rymut 2016 eq. (2.5), who does not state his: share of a frame in a mixture that
    goes on learning. By hand: OpenCV takes for scene what is a tenth of the mixture, so somebody
    may stand still for 210 frames."""


@dataclass(frozen=True)
class TakeConfig:
    """How the empty scene is learnt from a take in which somebody moves, see
    `psfs.background.take`.

    The defaults were set on four laboratory sequences without their pictures of the empty scene.
    """

    longest_side: int = 320
    """Longest side, px, of the small pictures that people are looked for in."""
    moving: float = 18.0
    """Change of a pixel over the take, grey levels, from which on something moved there."""
    gap: int = 9
    """Width, px, of gaps between what moved that are closed."""
    least_area: float = 40.0
    """Area, px, below which what moved is noise."""
    around: int = 30
    """Pixels around the region in which something moved that say how the background looks."""
    unlike: float = 14.0
    """Difference, grey levels, from the background around from which on a pixel looks like
    somebody at first."""
    cuts: int = 4
    """Iterations of GrabCut."""
    voxels: int = 60_000
    """Voxels of the coarse hull, at most."""
    explained: float = 0.62
    """Share of the silhouettes before the medians that all cameras' hull must explain, else
    somebody is looked for in the medians. People who walk about: 0.78; who stay in a place: 0.39,
    0.46."""
    judged: int = 4
    """Every so many samples are judged so."""
    denials: int = 1
    """Cameras that may deny a voxel, of more than three: their background may hold somebody."""
    margin: int = 1
    """Pixels by which the hull's picture is grown."""
    somebody: float = 5.0
    """Standard deviations from the background from which on a pixel is somebody."""
    shadow_width: float = 0.06
    """Standard deviation of the light factor around 1 of what is still background."""
    rounds: int = 3
    """Times that hull and background are made of each other, at most."""
    rest: float = 0.002
    """Share of the pixels that change their side below which nothing more is to be learnt."""
    least_free: int = 3
    """Frames that must show a pixel of the background, at least..."""
    free_share: float = 0.1
    """...and the share of them."""
    hidden_prior: float = 1.0
    """Log odds of somebody, nats, where the background is never seen and its median looks like
    somebody."""


@dataclass(frozen=True)
class BackgroundConfig:
    """The density of a background pixel's colour: N(I; alpha mu, sigma), Song et al. eq. (1) under
    a light dimmed or brightened by a factor alpha; the floor has rules of its own.

    The defaults were tuned on synthetic walks with true masks and on a real person on a green
    carpet.
    """

    sigma_floor: float = 3.0
    """Least standard deviation of the background, grey levels."""
    shadow_low: float = 0.5
    """Least light factor alpha; `shadow_low` = `shadow_high` = 1 switches these shadows off."""
    shadow_high: float = 1.1
    """Greatest light factor alpha."""
    shadow_width_grey: float = 0.02
    """Standard deviation of alpha around 1 before a grey background: a grey wall under less light
    looks like many clothes."""
    shadow_width_colour: float = 0.06
    """The same before a background of full saturation, linear between: a green carpet under less
    light looks like nothing else."""

    def __post_init__(self) -> None:
        if not 0 < self.shadow_low <= 1 <= self.shadow_high:
            raise InputError(
                f"the shadow range is {self.shadow_low}..{self.shadow_high}; "
                "expected 0 < low <= 1 <= high"
            )
        for name in ("sigma_floor", "shadow_width_grey", "shadow_width_colour"):
            check_range(name, getattr(self, name), 0)

    def shadow_width(self, mean: np.ndarray) -> np.ndarray:
        """Return the standard deviation (...) of alpha before a background of colour (..., 3)."""
        brightest = mean.max(-1)
        saturation = (brightest - mean.min(-1)) / np.maximum(brightest, 1)
        width: np.ndarray = self.shadow_width_grey + saturation * (
            self.shadow_width_colour - self.shadow_width_grey
        )
        return width


@dataclass(frozen=True)
class LightConfig:
    """How a picture's light is estimated beside the background's, see `psfs.background.light`.

    The defaults were set on the synthetic sequence hard_light_6cam and on drifts laid over
    synthetic sequences of steady light.
    """

    follow: bool = True
    """Estimate gains and offsets of every picture; else the light is that of the background."""
    widest: float = 16.0
    """Scale of the residuals, in standard deviations of the background, in the first step of the
    robust fit: wide enough for a change of light by half."""
    narrowest: float = 3.0
    """The same in the last steps: what is farther off than a few of these is somebody."""
    steps: int = 6
    """Steps of iteratively reweighted least squares; the scale halves in each, down to
    `narrowest`."""
    independent: float = 0.02
    """Share of the samples that count as independent beside the widths below."""
    gain_width: float = 0.3
    """Standard deviation of a channel's gain around 1."""
    offset_width: float = 4.0
    """Standard deviation of a channel's offset, grey levels."""
    field_width: float = 0.1
    """Standard deviation of the share by which the light grows from the middle of a picture to its
    border, along each axis."""

    def __post_init__(self) -> None:
        check_range("the light's steps", self.steps, 1, ends=True)
        check_range("the light's narrowest", self.narrowest, 0)
        check_range("the light's widest", self.widest, self.narrowest, ends=True)
        for name in ("independent", "gain_width", "offset_width", "field_width"):
            check_range(f"the light's {name}", getattr(self, name), 0)

    def scales(self) -> list[float]:
        """Return the scale of the residuals in each step."""
        return [max(self.narrowest, self.widest / 2**step) for step in range(self.steps)]


@dataclass(frozen=True)
class AdaptationConfig:
    """How the background takes on what changes in places, see `psfs.background.adaptation`.

    The defaults were set by hand; the tests hold them on synthetic scenes under fading light.
    """

    rate: float = 0.025
    """Share of the difference to the frame that the mean takes on per frame where nobody is; 0
    switches that off. It needs `AppearanceConfig.learn`."""
    period: int = 8
    """Frames in which every pixel is looked at once, a part of the picture in each: more
    often takes more time."""
    variance_slowdown: float = 4.0
    """The variance drifts so many times as slowly as the mean: it needs more samples."""
    nearest: float = 30.0
    """Squared distance to the background, in its standard deviations, of what it may drift to.
    Shadows and whatever else passes for background are further away, and leave no trace."""

    def __post_init__(self) -> None:
        if not 0 <= self.rate < 1:
            raise InputError(
                f"the adaptation's rate is {self.rate}; expected a number from 0 to below 1"
            )
        check_range("period", self.period, 1, ends=True)
        for name in ("variance_slowdown", "nearest"):
            check_range(name, getattr(self, name), 0)

    def rates(self) -> tuple[float, float]:
        """Return the share of the difference that a pixel's mean and variance take on each time
        that it is looked at."""
        mean, variance = (
            1 - (1 - rate) ** self.period
            for rate in (self.rate, self.rate / self.variance_slowdown)
        )
        return mean, variance


@dataclass(frozen=True)
class ScreenConfig:
    """How the screen of one colour is found in pictures, see `psfs.background.chroma_key`.

    The defaults were set by hand; the tests hold them on synthetic screens under uneven light.
    """

    samples: int = 12
    """Frames of every camera that the screen's colour is looked for in."""
    stride: int = 2
    """Every so many pixels are looked at, along both axes."""
    brightest: float = 30.0
    """Brightest channel, grey levels, below which a pixel's chromaticity is noise."""
    saturation: float = 0.12
    """Least saturation of a screen, see `psfs.common.colours.chromaticity`."""
    near: float = 0.12
    """Distance of chromaticities within which a pixel is of the screen's colour."""
    least_share: float = 0.1
    """Share of the pictures that a screen fills at least."""
    closing: int = 9
    """Edge, px, of gaps in the screen that are closed."""
    std: float = 2.0
    """Standard deviation, grey levels, that is stated for the screen's colour."""


@dataclass(frozen=True)
class ChromaKeyConfig:
    """The density of a screen's pixel, see `psfs.reference.chroma_key`.

    The defaults were set by hand; the tests hold them on synthetic screens with shade and spill.
    """

    spread: float = 0.03
    """Least standard deviation of the screen's chromaticity."""
    noise: float = 3.0
    """Grey levels of noise in a channel: dark pixels have no sure chromaticity."""
    dark: float = 0.3
    """Least light of the screen, as a share of its usual one: darker is black clothes."""
    bright: float = 2.0
    """Greatest light of the screen, as a share of its usual one: brighter is a lamp."""
    light_width: float = 0.05
    """Standard deviation of the light beyond that range."""

    def __post_init__(self) -> None:
        check_range("spread", self.spread, 0)


@dataclass(frozen=True)
class EvidenceConfig:
    """What a pixel's log ratio of background over foreground says of the voxels seen there.

    The limits were tuned on synthetic walks with true masks and on a real person on a green carpet.
    """

    foreground_prior: float = 0.5
    """P(F = 1) of a pixel: even odds."""
    occlusion_prior: float = 0.5
    """P(O) of Song et al. eq. (5): even odds."""
    clamp: float = 0.005
    """The silhouette likelihood stays within [clamp, 1 - clamp]: no single pixel vetoes a voxel."""
    mask_clamp: float = 1e-3
    """The same for ready masks, which deserve more trust than a background model."""
    foreground_limit: float = 6.0
    """Nats that a single pixel may say for the foreground in the mean over 3x3 pixels."""
    background_limit: float = 10.0
    """Nats that it may say for the background."""
    independent_pixels: float = 1.5
    """Independent pixels that those 3x3 count for; few, since where background and clothes look
    alike they do so all over."""

    def __post_init__(self) -> None:
        for name in ("foreground_prior", "occlusion_prior"):
            check_range(name, getattr(self, name), 0, 1)
        for name in ("clamp", "mask_clamp"):
            check_range(name, getattr(self, name), 0, 0.5)
        for name in ("foreground_limit", "background_limit", "independent_pixels"):
            check_range(name, getattr(self, name), 0)

    def log_odds(self, likelihood: np.ndarray, clamp: float) -> np.ndarray:
        """Return what a pixel adds to the log odds of a voxel seen there, nats.

        From Song et al. eq. (5)-(9): P(S|V=1) = SLM and P(S|V=0) = P(O) SLM + (1-P(O)) (1-SLM),
        hence log(SLM / (P(O) SLM + (1-P(O)) (1-SLM))), which is log(SLM / 0.5) for P(O) = 0.5.
        It is positive where SLM > 0.5, whatever P(O).
        """
        slm = np.clip(likelihood, clamp, 1 - clamp)
        occluded = self.occlusion_prior
        odds: np.ndarray = np.log(slm / (occluded * slm + (1 - occluded) * (1 - slm)))
        return odds

    @cached_property
    def step(self) -> float:
        """Nats per count of the evidence maps: the strongest evidence is 127 counts."""
        strongest = self.log_odds(np.array([0.0, 1.0]), min(self.clamp, self.mask_clamp))
        return float(np.abs(strongest).max() / 127)

    @property
    def ratio_steps(self) -> float:
        """Counts per nat of the log ratios of single pixels, background over foreground."""
        return 120 / max(self.foreground_limit, self.background_limit)

    @property
    def ratio_range(self) -> tuple[int, int]:
        """Lowest and highest log ratio of a pixel, counts."""
        low, high = -self.foreground_limit, self.background_limit
        return round(low * self.ratio_steps), round(high * self.ratio_steps)

    def ratio_counts(self) -> np.ndarray:
        """Return evidence counts (int8) of every sum of 3x3 log ratios from the least to the
        greatest.

        Holds Song et al. eq. (1) and (5)-(9) and spares the kernel one exp and one log per pixel.
        """
        low, high = self.ratio_range
        mean = np.arange(9 * low, 9 * high + 1) / (9 * self.ratio_steps)
        prior = self.foreground_prior
        return self.counts(prior / (prior + (1 - prior) * np.exp(self.independent_pixels * mean)))

    def counts(self, likelihood: np.ndarray) -> np.ndarray:
        """Return the evidence of silhouette likelihoods in whole counts of `step`, int8."""
        return np.rint(self.log_odds(likelihood, self.clamp) / self.step).astype(np.int8)

    def likelihood(self, counts: np.ndarray) -> np.ndarray:
        """Return the silhouette likelihoods, float64, of evidence in counts: the inverse of
        `counts`, but for what was clipped and rounded."""
        odds, occluded = np.exp(self.step * counts.astype(np.float64)), self.occlusion_prior
        slm: np.ndarray = odds * (1 - occluded) / (1 + odds * (1 - 2 * occluded))
        return slm

    def mask_counts(self, masks: np.ndarray) -> np.ndarray:
        """Return the evidence counts, int8, of ready masks, 0..255."""
        evidence = self.log_odds(np.asarray(masks) / 255, self.mask_clamp)
        return np.rint(evidence / self.step).astype(np.int8)
