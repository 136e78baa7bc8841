"""Settings of the background: its estimation, its density, and the evidence of a pixel."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

from psfs.common.config import Config, setting

if TYPE_CHECKING:
    import numpy as np


class PlateConfig(Config):
    """Settings of the background's estimation from pictures of the empty scene, see
    `psfs.background.gaussian`."""

    SOURCE: ClassVar = "by hand"

    std_floor: float = setting(
        2.0,
        "Least standard deviation that is learnt: a noiseless background must not make "
        "N(I; mu, sigma) explode.",
        unit="grey levels",
        above=0,
    )
    prior_std: float = setting(
        6.0,
        "Standard deviation that is believed in before any frame is seen.",
        unit="grey levels",
        above=0,
    )
    prior_frames: float = setting(
        2.0,
        "Weight of `prior_std`. A single picture as background thus gets 4.9 grey levels.",
        unit="frames",
        least=0,
    )
    clip: float = setting(
        3.0,
        "Distance from the mean beyond which a value is left out of it.",
        "the usual 3 sigma",
        "standard deviations",
        above=0,
    )
    samples: int = setting(
        25,
        "Number of frames that a background is learnt from when the scene is never empty.",
        "by hand: enough for a median",
        "frames",
        least=1,
    )
    mixture_samples: int = setting(
        50,
        "Number of frames that mixtures of Gaussians are learnt from when the scene is never "
        "empty.",
        unit="frames",
        least=1,
    )
    mixture_rate: float = setting(
        0.0005,
        "Share of a frame in a mixture that goes on learning, alpha of Rymut 2016 eq. (2.5). "
        "OpenCV takes for scene what is a tenth of the mixture, so somebody may stand still for "
        "210 frames.",
        "by hand; Rymut does not state his",
        least=0,
        most=1,
    )


class TakeConfig(Config):
    """Settings of the background's estimation from a take with people in it, see
    `psfs.background.take`."""

    SOURCE: ClassVar = (
        "by hand, on synth_box_4cam, synth_jacks_6cam, synth_pickup_6cam without their plates"
    )

    longest_side: int = setting(
        320,
        "Longest side of the small pictures that people are looked for in.",
        unit="px",
        least=32,
    )
    moving: float = setting(
        18.0,
        "Change of a pixel over the take from which on something moved there.",
        unit="grey levels",
        above=0,
    )
    gap: int = setting(9, "Width of gaps between what moved that are closed.", unit="px", least=1)
    least_area: float = setting(40.0, "Area below which what moved is noise.", unit="px^2", least=0)
    extrapolated_std: float = setting(
        10.0,
        "Standard deviation of a background that is extrapolated into the region where something "
        "moved.",
        unit="grey levels",
        above=0,
    )
    unlike: float = setting(
        -2.0,
        "Evidence for the person below which an extrapolated background replaces one that is never "
        "seen.",
        unit="nats",
    )
    least_std: float = setting(
        5.0, "Least standard deviation of a learnt background.", unit="grey levels", above=0
    )
    median_blur: float = setting(
        1.5,
        "Standard deviation of the blur of the map that says where the median is background.",
        unit="px",
        above=0,
    )
    colour_limit: float = setting(
        4.0, "Most that a pixel's colour may say for or against the person.", unit="nats", above=0
    )
    least_evidence: float = setting(
        -1.0,
        "Mean over 3 x 3 pixels of what their colours say for the person, from which on a pixel "
        "may be the person's.",
        unit="nats",
    )
    voxels: int = setting(
        60_000, "Number of voxels of the coarse hull, at most.", unit="voxels", least=1000
    )
    explained: float = setting(
        0.62,
        "Share of the silhouettes before the medians that all cameras' hull must explain, else "
        "the medians show somebody.",
        "between people who walk about and who stay in a place",
        least=0,
        most=1,
    )
    judged: int = setting(4, "Number of samples of which one is judged so.", least=1)
    denials: int = setting(
        1,
        "Number of cameras, of more than three, that may deny a voxel: their background may hold "
        "somebody.",
        least=0,
    )
    margin: int = setting(1, "Distance by which the hull's picture is grown.", unit="px", least=0)
    shadow_width: float = setting(
        0.06, "Standard deviation of the light factor around 1 of what is background.", above=0
    )
    rounds: int = setting(
        3, "Number of times that hull and background are made of each other, at most.", least=1
    )
    rest: float = setting(
        0.002,
        "Share of the pixels that change sides below which nothing more is learnt.",
        least=0,
        most=1,
    )
    least_free: int = setting(
        3, "Number of frames that must show a pixel of the background.", unit="frames", least=1
    )
    free_share: float = setting(
        0.1, "Share of the frames that must show a pixel of the background.", least=0, most=1
    )
    hidden_prior: float = setting(
        1.0,
        "Log odds of somebody where the background is never seen.",
        unit="nats",
        least=0,
    )


class BackgroundConfig(Config):
    """Settings of the density of a background pixel's colour: N(I; alpha mu, sigma), which is Song
    et al. eq. (1) with light dimmed or brightened by a factor alpha. The floor has rules of its
    own."""

    SOURCE: ClassVar = (
        "tuned on synthetic walks with true masks and on a real person on a green carpet"
    )

    sigma_floor: float = setting(
        3.0, "Least standard deviation of the background.", unit="grey levels", above=0
    )
    shadow_low: float = setting(
        0.5,
        "Least light factor alpha; `shadow_low` = `shadow_high` = 1 switches these shadows off.",
        above=0,
        most=1,
    )
    shadow_high: float = setting(1.1, "Greatest light factor alpha.", least=1)
    shadow_width_grey: float = setting(
        0.02,
        "Standard deviation of alpha around 1 before a grey background: a grey wall under less "
        "light looks like many clothes.",
        above=0,
    )
    shadow_width_colour: float = setting(
        0.06,
        "Standard deviation of alpha around 1 before a background of full saturation, linear "
        "between: a green carpet under less light looks like nothing else.",
        above=0,
    )

    def shadow_width(self, mean: np.ndarray) -> np.ndarray:
        """Return the standard deviation (...) of alpha for a background of mean colour (..., 3)."""
        import numpy as np

        brightest = mean.max(-1)
        saturation = (brightest - mean.min(-1)) / np.maximum(brightest, 1)
        width: np.ndarray = self.shadow_width_grey + saturation * (
            self.shadow_width_colour - self.shadow_width_grey
        )
        return width


class LightConfig(Config):
    """Settings of the estimation of a picture's light relative to the background's, see
    `psfs.background.light`."""

    SOURCE: ClassVar = (
        "by hand, on hard_light_6cam and on drifts laid over synthetic sequences of steady light"
    )

    follow: bool = setting(
        True, "Estimate every picture's light; else it is that of the background."
    )
    widest: float = setting(
        16.0,
        "Scale of the residuals in the first step of the robust fit: wide enough for a change of "
        "light by half.",
        unit="standard deviations",
        above=0,
    )
    narrowest: float = setting(
        3.0,
        "The same in the last steps: what is farther off than a few of these is somebody.",
        unit="standard deviations",
        above=0,
    )
    steps: int = setting(
        6,
        "Number of steps of iteratively reweighted least squares. The scale halves in each, down "
        "to `narrowest`.",
        least=1,
    )
    independent: float = setting(
        0.02, "Share of the samples that count as independent beside the widths.", above=0, most=1
    )
    gain_width: float = setting(0.3, "Standard deviation of a channel's gain around 1.", above=0)
    offset_width: float = setting(
        4.0, "Standard deviation of a channel's offset.", unit="grey levels", above=0
    )
    field_width: float = setting(
        0.1,
        "Standard deviation of the share by which the light grows from the middle of a picture to "
        "its border, along each axis.",
        above=0,
    )

    def scales(self) -> list[float]:
        """Return the scale of the residuals in each step."""
        return [max(self.narrowest, self.widest / 2**step) for step in range(self.steps)]


class AdaptationConfig(Config):
    """Settings of the background's adaptation to local changes, see
    `psfs.background.adaptation`."""

    SOURCE: ClassVar = "by hand; the tests hold it on synthetic scenes under fading light"

    rate: float = setting(
        0.025,
        "Share of the difference to the frame that the mean takes on per frame where nobody is; 0 "
        "switches that off. It needs `AppearanceConfig.learn`.",
        least=0,
        below=1,
    )
    period: int = setting(
        8,
        "Number of frames in which every pixel is looked at once, a part of the picture in each: "
        "more often takes more time.",
        unit="frames",
        least=1,
    )
    variance_slowdown: float = setting(
        4.0,
        "Factor by which the variance drifts more slowly than the mean: it needs more samples.",
        above=0,
    )
    nearest: float = setting(
        30.0,
        "Squared distance to the background of what it may drift to. Shadows and whatever else "
        "passes for background are further away, and leave no trace.",
        unit="squared standard deviations",
        above=0,
    )

    def rates(self) -> tuple[float, float]:
        """Return the shares of the difference by which a pixel's mean and variance change at each
        of its updates."""
        mean, variance = (
            1 - (1 - rate) ** self.period
            for rate in (self.rate, self.rate / self.variance_slowdown)
        )
        return mean, variance


class ScreenConfig(Config):
    """Settings of the search for the screen of one colour in pictures, see
    `psfs.background.chroma_key`."""

    SOURCE: ClassVar = "by hand; the tests hold it on synthetic screens under uneven light"

    samples: int = setting(
        12,
        "Number of frames of every camera in which the screen's colour is looked for.",
        unit="frames",
        least=1,
    )
    stride: int = setting(
        2, "Distance, along both axes, of the pixels that are looked at.", unit="px", least=1
    )
    brightest: float = setting(
        30.0,
        "Brightest channel below which a pixel's chromaticity is noise.",
        unit="grey levels",
        least=0,
    )
    saturation: float = setting(
        0.12,
        "Least saturation of a screen, see `psfs.common.colours.chromaticity`.",
        least=0,
        most=1,
    )
    near: float = setting(
        0.12, "Distance of chromaticities within which a pixel is of the screen's colour.", above=0
    )
    least_share: float = setting(
        0.1, "Least share of the pictures that a screen fills.", least=0, most=1
    )
    closing: int = setting(9, "Edge of gaps in the screen that are closed.", unit="px", least=1)
    std: float = setting(
        2.0,
        "Standard deviation that is stated for the screen's colour.",
        unit="grey levels",
        above=0,
    )


class ChromaKeyConfig(Config):
    """Settings of the density of a screen's pixel, see `psfs.reference.chroma_key`."""

    SOURCE: ClassVar = "by hand; the tests hold it on synthetic screens with shade and spill"

    spread: float = setting(0.03, "Least standard deviation of the screen's chromaticity.", above=0)
    noise: float = setting(
        3.0,
        "Noise of a channel: dark pixels have no sure chromaticity.",
        unit="grey levels",
        least=0,
    )
    dark: float = setting(
        0.3,
        "Least light of the screen, as a share of its usual one: darker is black clothes.",
        least=0,
    )
    bright: float = setting(
        2.0,
        "Greatest light of the screen, as a share of its usual one: brighter is a lamp.",
        least=0,
    )
    light_width: float = setting(
        0.05, "Standard deviation of the light beyond that range.", above=0
    )


class EvidenceConfig(Config):
    """Settings of the evidence that a pixel's log ratio of background over foreground gives for the
    voxels projected there."""

    SOURCE: ClassVar = (
        "tuned on synthetic walks with true masks and on a real person on a green carpet"
    )

    foreground_prior: float = setting(
        0.5, "Prior probability P(F = 1) of a pixel.", "even odds", above=0, below=1
    )
    occlusion_prior: float = setting(
        0.5, "Prior probability P(O) of Song et al. eq. (5).", "even odds", above=0, below=1
    )
    clamp: float = setting(
        0.005,
        "Distance from 0 and 1 that the silhouette likelihood keeps: no single pixel vetoes a "
        "voxel.",
        above=0,
        below=0.5,
    )
    mask_clamp: float = setting(
        1e-3,
        "Distance from 0 and 1 that the likelihood of ready masks keeps: they deserve more trust "
        "than a background model.",
        above=0,
        below=0.5,
    )
    foreground_limit: float = setting(
        6.0,
        "Most that a single pixel may say for the foreground in the mean over 3x3 pixels.",
        unit="nats",
        above=0,
    )
    background_limit: float = setting(
        10.0,
        "Most that a single pixel may say for the background in the mean over 3x3 pixels.",
        unit="nats",
        above=0,
    )
    independent_pixels: float = setting(
        1.5,
        "Number of independent pixels that those 3x3 count for: few, since where background and "
        "clothes look alike they do so all over.",
        above=0,
    )

    def log_odds(self, likelihood: np.ndarray, clamp: float) -> np.ndarray:
        """Return the nats that a pixel adds to the log odds of a voxel projected there.

        From Song et al. eq. (5)-(9): P(S|V=1) = SLM and P(S|V=0) = P(O) SLM + (1-P(O)) (1-SLM),
        hence log(SLM / (P(O) SLM + (1-P(O)) (1-SLM))), which is log(SLM / 0.5) for P(O) = 0.5.
        It is positive where SLM > 0.5, whatever P(O).
        """
        import numpy as np

        slm = np.clip(likelihood, clamp, 1 - clamp)
        occluded = self.occlusion_prior
        odds: np.ndarray = np.log(slm / (occluded * slm + (1 - occluded) * (1 - slm)))
        return odds

    @cached_property
    def step(self) -> float:
        """Nats per count of the evidence maps: the strongest evidence is 127 counts."""
        import numpy as np

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
        """Return the evidence counts, int8, of every sum of 3x3 log ratios, from the least to the
        greatest.

        The table implements Song et al. eq. (1) and (5)-(9) and saves the kernel one exp and one
        log per pixel.
        """
        import numpy as np

        low, high = self.ratio_range
        mean = np.arange(9 * low, 9 * high + 1) / (9 * self.ratio_steps)
        prior = self.foreground_prior
        return self.counts(prior / (prior + (1 - prior) * np.exp(self.independent_pixels * mean)))

    def counts(self, likelihood: np.ndarray) -> np.ndarray:
        """Return the evidence of silhouette likelihoods in whole counts of `step`, int8."""
        import numpy as np

        return np.rint(self.log_odds(likelihood, self.clamp) / self.step).astype(np.int8)

    def likelihood(self, counts: np.ndarray) -> np.ndarray:
        """Return the silhouette likelihoods, float64, of evidence in counts: the inverse of
        `counts` up to clipping and rounding."""
        import numpy as np

        odds, occluded = np.exp(self.step * counts.astype(np.float64)), self.occlusion_prior
        slm: np.ndarray = odds * (1 - occluded) / (1 + odds * (1 - 2 * occluded))
        return slm

    def mask_counts(self, masks: np.ndarray) -> np.ndarray:
        """Return the evidence counts, int8, of ready masks, 0..255."""
        import numpy as np

        evidence = self.log_odds(np.asarray(masks) / 255, self.mask_clamp)
        return np.rint(evidence / self.step).astype(np.int8)
