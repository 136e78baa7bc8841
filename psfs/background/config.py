"""Settings of the background: its density, its changes, and the evidence of a pixel."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

from psfs.common.config import Config, positive, setting

if TYPE_CHECKING:
    import numpy as np

#: Evidence count of a pixel without information; all others are -127 to 127.
UNKNOWN = -128


class BackgroundConfig(Config):
    """Settings of the density of a background pixel's colour: N(I; alpha mu, sigma), which is Song
    et al. eq. (1) with light dimmed or brightened by a factor alpha. The floor has rules of its
    own."""

    SOURCE: ClassVar = "tuned with true masks"

    sigma_floor: float = positive(
        3.0, "Least standard deviation of the background.", unit="grey levels"
    )
    shadow_low: float = setting(
        0.5,
        "Least light factor alpha; `shadow_low` = `shadow_high` = 1 switches these shadows off.",
        above=0,
        most=1,
    )
    shadow_high: float = setting(1.1, "Greatest light factor alpha.", least=1)
    shadow_width_grey: float = positive(
        0.02,
        "Standard deviation of alpha around 1 for a grey background; small, because a grey "
        "wall under less light looks like many clothes.",
    )
    shadow_width_colour: float = positive(
        0.06,
        "Standard deviation of alpha around 1 for a background of full saturation, "
        "interpolated linearly between the two: a coloured carpet under less light is not "
        "mistaken for clothes.",
    )

    def shadow_width(self, mean: np.ndarray) -> np.ndarray:
        """Return the standard deviation (...) of alpha for a background of mean colour (..., 3)."""
        import numpy as np

        brightest = mean.max(-1)
        saturation = (brightest - mean.min(-1)) / np.maximum(brightest, 1)
        return self.shadow_width_grey + saturation * (
            self.shadow_width_colour - self.shadow_width_grey
        )


class LightConfig(Config):
    """Settings of the estimation of a picture's light relative to the background's, see
    `psfs.background.light`."""

    follow: bool = setting(
        True,
        "Estimate every picture's light; else it is that of the background.",
        "daylight, and the gains of cameras, change within a take",
    )


class EvidenceConfig(Config):
    """Settings of the evidence that a pixel's log ratio of background over foreground gives for the
    voxels projected there."""

    SOURCE: ClassVar = "tuned with true masks"

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
    unknown_mask: int | None = setting(
        None,
        "Value of mask pixels that are unknown, for example where furniture hides the person; "
        "none if all pixels are known.",
        "masks of one of several people have unknown pixels",
        least=0,
        most=255,
    )
    foreground_limit: float = positive(
        6.0,
        "Greatest evidence for the foreground of a single pixel in the mean over 3x3 pixels.",
        unit="nats",
    )
    background_limit: float = positive(
        10.0,
        "Greatest evidence for the background of a single pixel in the mean over 3x3 pixels.",
        unit="nats",
    )
    independent_pixels: float = positive(
        1.5,
        "Effective number of independent pixels among those 3x3; low, because errors of "
        "neighbouring pixels are correlated where background and clothes look alike.",
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
        return np.log(slm / (occluded * slm + (1 - occluded) * (1 - slm)))

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
        return odds * (1 - occluded) / (1 + odds * (1 - 2 * occluded))

    def mask_counts(self, masks: np.ndarray) -> np.ndarray:
        """Return the evidence counts, int8, of ready masks, 0..255: `UNKNOWN` where they say
        nothing."""
        import numpy as np

        evidence = self.log_odds(np.asarray(masks) / 255, self.mask_clamp)
        counts = np.rint(evidence / self.step).astype(np.int8)
        if self.unknown_mask is not None:
            counts[np.asarray(masks) == self.unknown_mask] = UNKNOWN
        return counts
