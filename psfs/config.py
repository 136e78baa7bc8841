"""The parameters of the reconstruction, shared by the kernels and their NumPy twins."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from functools import cached_property

import numpy as np

from cl import InputError
from psfs.cameras.rig_geometry import enough_cameras
from psfs.common.ranges import check_range


@dataclass(frozen=True)
class SilhouetteConfig:
    """Parameters of the silhouette likelihood map (Song et al. eq. 1-2) and of its evidence.

    The defaults were chosen on synthetic walks with true masks and on a real person on a green
    carpet.

    sigma_floor: least standard deviation of the background, grey levels.
    foreground_prior: P(F = 1) of a pixel.
    clamp: the map stays within [clamp, 1 - clamp], so that no single pixel vetoes a voxel;
    mask_clamp: the same for ready masks, which deserve more trust than a background model.
    occlusion_prior: P(O) of Song et al. eq. (5).
    shadow_low, shadow_high: the background may be seen under a light dimmed or brightened by a
    factor alpha in this range; shadow_low = shadow_high = 1 switches these shadows off. The floor
    has rules of its own.
    shadow_width_grey, shadow_width_colour: standard deviation of alpha around 1, before a grey
    background and before one of full saturation, linear between: a grey wall under less light
    looks like many clothes, a green carpet under less light like nothing else.
    floor: height of the floor, m. A shadow that falls there is the same for all cameras: it may
    be as dark as floor_shadow_low, but the floor is not darker for one camera than for the one
    that sees it brightest, but for a standard deviation floor_shadow_width of alpha, and where
    that one sees it lit, it is lit for all but for floor_lit_width: arms before a floor of their
    colour are not mistaken for shaded floor. alpha itself has the standard deviation
    floor_shadow_depth around 1: shoes are darker than shadows.
    key_spread: before a screen of one colour, least standard deviation of its chromaticity.
    foreground_limit, background_limit: nats that a single pixel may say for the foreground or the
    background in the mean over 3x3 pixels. independent: how many independent pixels those 3x3
    count for; few, since where background and clothes look alike they do so all over.
    rim_share, rim_cost: a pixel of the silhouette's rim, where the person's colour and the
    background's are mixed, is background up to that share of the person's, at the price of
    rim_cost nats; else rims of mixed pixels, which fit no background, would widen silhouettes.
    adapt: share of the difference to the frame that the background takes on per frame where nobody
    is, see `psfs.background.adaptation`; 0 switches that off. It needs `learn`.
    learn: let the reconstructed person teach colours and place for the next frame; see
    `psfs.silhouettes.appearance`. place_inside, place_outside: P(F = 1) of a pixel well within
    the person's place of the frame before and of one well outside, instead of
    foreground_prior. look_again:
    work twice on a frame that does not follow shortly after the one before, the second time knowing
    the person's place; else only on the very first one, which takes half the time.
    """

    sigma_floor: float = 3.0
    foreground_prior: float = 0.5
    clamp: float = 0.005
    mask_clamp: float = 1e-3
    occlusion_prior: float = 0.5
    shadow_low: float = 0.5
    shadow_high: float = 1.1
    shadow_width_grey: float = 0.02
    shadow_width_colour: float = 0.06
    foreground_limit: float = 6.0
    background_limit: float = 10.0
    independent: float = 1.5
    floor: float = 0.0
    floor_shadow_low: float = 0.15
    floor_shadow_width: float = 0.05
    floor_lit_width: float = 0.025
    floor_shadow_depth: float = 0.45
    rim_share: float = 0.5
    rim_cost: float = 3.0
    key_spread: float = 0.03
    adapt: float = 0.025
    learn: bool = True
    place_inside: float = 0.98
    place_outside: float = 0.3
    look_again: bool = True

    def __post_init__(self) -> None:
        shares = ("place_inside", "place_outside", "rim_share")
        for name in ("foreground_prior", "occlusion_prior", *shares):
            check_range(name, getattr(self, name), 0, 1)
        for name in ("clamp", "mask_clamp"):
            check_range(name, getattr(self, name), 0, 0.5)
        if not 0 <= self.adapt < 1:
            raise InputError(f"adapt is {self.adapt}; expected a number from 0 to below 1")
        if not 0 < self.shadow_low <= 1 <= self.shadow_high:
            raise InputError(
                f"the shadow range is {self.shadow_low}..{self.shadow_high}; "
                "expected 0 < low <= 1 <= high"
            )
        widths = (
            "shadow_width_grey",
            "shadow_width_colour",
            "floor_shadow_width",
            "floor_lit_width",
            "floor_shadow_depth",
        )
        limits = ("foreground_limit", "background_limit", "rim_cost")
        for name in ("sigma_floor", "key_spread", *widths, *limits, "independent"):
            check_range(name, getattr(self, name), 0)

    @property
    def floor_lit(self) -> float:
        """Light factor above which the floor passes for lit."""
        return 1 - 2 * self.floor_shadow_width

    def shadow_width(self, mean: np.ndarray) -> np.ndarray:
        """Standard deviation (...) of the light factor before a background of colour (..., 3)."""
        brightest = mean.max(-1)
        saturation = (brightest - mean.min(-1)) / np.maximum(brightest, 1)
        width: np.ndarray = self.shadow_width_grey + saturation * (
            self.shadow_width_colour - self.shadow_width_grey
        )
        return width

    def evidence(self, likelihood: np.ndarray, clamp: float) -> np.ndarray:
        """What a pixel adds to the log-odds of a voxel seen there, nats.

        From Song et al. eq. (5)-(9): P(S|V=1) = SLM and P(S|V=0) = P(O) SLM + (1-P(O)) (1-SLM),
        hence log(SLM / (P(O) SLM + (1-P(O)) (1-SLM))), which is log(SLM / 0.5) for P(O) = 0.5.
        It is positive where SLM > 0.5, whatever P(O).
        """
        slm = np.clip(likelihood, clamp, 1 - clamp)
        occluded = self.occlusion_prior
        evidence: np.ndarray = np.log(slm / (occluded * slm + (1 - occluded) * (1 - slm)))
        return evidence

    @cached_property
    def step(self) -> float:
        """Nats per count of the evidence maps: the strongest evidence is 127 counts."""
        strongest = self.evidence(np.array([0.0, 1.0]), min(self.clamp, self.mask_clamp))
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
        """Evidence counts (int8) for every sum of 3x3 log ratios from the least to the greatest.

        Holds Song et al. eq. (1) and (5)-(9) and spares the kernel one exp and one log per pixel.
        """
        low, high = self.ratio_range
        mean = np.arange(9 * low, 9 * high + 1) / (9 * self.ratio_steps)
        prior = self.foreground_prior
        return self.counts(prior / (prior + (1 - prior) * np.exp(self.independent * mean)))

    def counts(self, likelihood: np.ndarray) -> np.ndarray:
        """Evidence of silhouette likelihoods in whole counts of `step`, int8."""
        return np.rint(self.evidence(likelihood, self.clamp) / self.step).astype(np.int8)

    def mask_counts(self, masks: np.ndarray) -> np.ndarray:
        """The same of ready masks, 0..255."""
        evidence = self.evidence(np.asarray(masks) / 255, self.mask_clamp)
        return np.rint(evidence / self.step).astype(np.int8)


@dataclass(frozen=True)
class OccupancyConfig:
    """Parameters of the voxel occupancy (Song et al. eq. 3-9).

    prior: P(V = 1) of a voxel. threshold: smoothed probability above which it is occupied.
    min_cameras: a voxel within fewer images is empty; None asks for half of the cameras, at
    least three (or all, if there are fewer).
    """

    prior: float = 0.5
    threshold: float = 0.6
    min_cameras: int | None = None

    def __post_init__(self) -> None:
        check_range("prior", self.prior, 0, 1)
        check_range("threshold", self.threshold, 0, 1)

    def seeing_cameras(self, n_cameras: int) -> int:
        if self.min_cameras is not None:
            return self.min_cameras
        return enough_cameras(n_cameras, 0.5, 3)

    def probabilities(self, n_cameras: int, step: float) -> np.ndarray:
        """Occupancy for every sum of evidence counts from -127 V to 127 V, (254 V + 1,).

        Entry s + 127 V is 1 / (1 + exp(-(logit(prior) + s step))): Song et al. eq. (3).
        """
        counts = np.arange(-127 * n_cameras, 127 * n_cameras + 1)
        logit = np.log(self.prior / (1 - self.prior))
        return np.asarray(1 / (1 + np.exp(-(logit + counts * step))))


@dataclass(frozen=True)
class ReconstructionConfig:
    silhouette: SilhouetteConfig = field(default_factory=SilhouetteConfig)
    occupancy: OccupancyConfig = field(default_factory=OccupancyConfig)

    def to_dict(self) -> dict[str, dict[str, float | int | None]]:
        """Plain values, for summaries."""
        return asdict(self)
