"""The tracker's settings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cl import InputError
from psfs.common.ranges import check_range

#: Frame rate that the sigmas of body models are stated for.
SIGMA_FPS = 60.0


#: Terms of the voxels' likelihood: the usual ones, and the weights of those off by default.
USUAL_TERMS = ("edge", "silhouette", "surface", "overlap", "posture")
_WEIGHTS_OF_OTHERS = {"two-sided": 2.0, "colour": 1.0, "smoothness": 0.01}
TERMS = (*USUAL_TERMS, *_WEIGHTS_OF_OTHERS)


def likelihood_weights(text: str) -> dict[str, float]:
    """Settings of a FilterConfig for `edge,silhouette=2`: these terms with their default weights or
    the stated ones, all others 0. Raises InputError for unknown terms and bad weights."""
    weights = {_weight_name(term): 0.0 for term in TERMS} | {"limb_two_sided": 0.0}
    for entry in text.split(","):
        term, _, value = entry.partition("=")
        if term not in TERMS:
            raise InputError(f"likelihood {text!r}: no term {term!r}; expected {', '.join(TERMS)}")
        name = _weight_name(term)
        usual = _WEIGHTS_OF_OTHERS.get(term, getattr(FilterConfig, name))
        try:
            weights[name] = float(value or usual)
        except ValueError:
            raise InputError(f"likelihood {text!r}: {value!r} is no weight of {term}") from None
    return weights


def _weight_name(term: str) -> str:
    return term.replace("-", "_") + "_weight"


@dataclass(frozen=True)
class FilterConfig:
    """Settings of the annealed particle filter; the defaults are Song et al.'s where they say.

    n_particles, n_layers: size of the search. first_survival, last_survival: effective sample size
    over number of particles that the exponent beta of the first and the last layer reaches, linear
    in between. noise: scale of the body's sigma in the first layer; noise_decay: its factor from
    layer to layer; spread: where positive, noise after the first layer is at most this times the
    set's own deviation; velocity: share of the last change that is expected again, 0 for Song et
    al. eq. (13), 1 for constant velocity; trunk_layers: so many first layers move the trunk alone.
    edge_weight, silhouette_weight: of Song et al. eq. (14) and (15); surface_weight: of the share
    of surface voxels that the cones leave unexplained, counted once per camera; overlap_weight: of
    the depth to which parts that must stay apart meet, likewise; two_sided_weight: of the share of
    the silhouettes that the body leaves uncovered; posture_weight: of the squared distance from
    rest, in the body's eases, which settles where an arm is that the voxels do not show;
    colour_weight: of the share of surface voxels whose colour is not that of the part nearest to
    them, see `LimbColours`, whose colours agree by half at colour_scale and move by the share
    colour_rate after each frame; smoothness_weight: of the mean squared change since the last
    frame, in smoothness_scale times the body's sigmas (at 60 frames/s), see `Smoothness`; all six
    are 0 for Song's likelihood alone. surface_scale: distance, m, at which a voxel is half
    unexplained; n_points: surface voxels that are looked at, by the refinement at all of them, by
    each layer at every `point_turns`-th, in turn. sample_spacing: distance, m, between samples on a
    cone. limb_spread: up to how many sigma (at 60 frames/s) limbs are looked for elsewhere before
    an estimate is settled, besides anywhere within their limits; 0 for not at all. limb_margin,
    limb_far_margin: share by which the error must fall for a limb to be moved there, and anywhere;
    limb_two_sided: least weight of the two-sided term in that error.
    """

    n_particles: int = 200
    n_layers: int = 10
    first_survival: float = 0.5
    last_survival: float = 0.05
    noise: float = 0.35
    noise_decay: float = 0.8
    spread: float = 0.0
    velocity: float = 0.5
    trunk_layers: int = 3
    edge_weight: float = 4.0
    silhouette_weight: float = 1.0
    surface_weight: float = 4.0
    overlap_weight: float = 1.0
    two_sided_weight: float = 0.0
    posture_weight: float = 0.04
    colour_weight: float = 0.0
    colour_scale: float = 0.1
    colour_rate: float = 0.1
    smoothness_weight: float = 0.0
    smoothness_scale: float = 1.0
    surface_scale: float = 0.05
    n_points: int = 1024
    point_turns: int = 8
    sample_spacing: float = 0.06
    refine_steps: int = 4
    refine_scale: float = 0.03
    refine_reach: float = 0.06
    refine_strength: float = 1350.0
    refine_width: float = 4.0
    limb_spread: float = 16.0
    limb_margin: float = 0.01
    limb_far_margin: float = 0.05
    limb_two_sided: float = 2.0
    seed: int = 0

    def __post_init__(self) -> None:
        check_range("n_particles", self.n_particles, 2, ends=True)
        for name in ("n_layers", "n_points", "point_turns"):
            check_range(name, getattr(self, name), 1, ends=True)
        if not 0 <= self.seed < 2**64:
            raise InputError(f"the seed is {self.seed}; expected 0 to 2^64 - 1")
        for name in ("first_survival", "last_survival"):
            rate = getattr(self, name)
            if not 1 / self.n_particles < rate < 1:
                raise InputError(
                    f"{name} is {rate}; expected between 1 / n_particles = "
                    f"{1 / self.n_particles:.3g} and 1"
                )
        check_range("colour_rate", self.colour_rate, 0, 1, ends=True)
        positive = (
            "noise", "noise_decay", "surface_scale", "sample_spacing",
            "refine_scale", "refine_reach", "refine_strength", "refine_width",
            "colour_scale", "colour_rate", "smoothness_scale",
        )  # fmt: skip
        others = (
            "spread", "velocity", "edge_weight", "silhouette_weight", "surface_weight",
            "overlap_weight", "two_sided_weight", "posture_weight", "colour_weight",
            "smoothness_weight", "limb_spread", "limb_margin", "limb_far_margin", "limb_two_sided",
            "trunk_layers", "refine_steps",
        )  # fmt: skip
        for name in positive:
            check_range(name, getattr(self, name), 0)
        for name in others:
            check_range(name, getattr(self, name), 0, ends=True)

    def at_rate(self, fps: float) -> FilterConfig:
        """Return the config with the noise that `fps` frames per second need, and smoothness that
        bears it."""
        longer = SIGMA_FPS / fps
        return replace(
            self, noise=self.noise * longer, smoothness_scale=self.smoothness_scale * longer
        )

    @property
    def weights(self) -> np.ndarray:
        """(4,) float32 weights of edge, silhouette, surface and overlap error."""
        return np.array(
            [self.edge_weight, self.silhouette_weight, self.surface_weight, self.overlap_weight],
            np.float32,
        )

    @property
    def looks_for_limbs(self) -> bool:
        """Whether limbs are looked for elsewhere before an estimate is settled."""
        return self.limb_spread > 0 and self.refine_steps > 0

    @property
    def settling_two_sided(self) -> float:
        """Weight of the two-sided term where an estimate is settled."""
        return max(self.two_sided_weight, self.limb_two_sided if self.looks_for_limbs else 0.0)

    @property
    def remembers(self) -> bool:
        """Whether the likelihood has terms that depend on the track so far."""
        return self.colour_weight > 0 or self.smoothness_weight > 0

    @property
    def refine_shrink(self) -> float:
        """Factor from step to step that takes `refine_reach` to `refine_scale`."""
        ratio = self.refine_scale / self.refine_reach
        return float(min(1.0, ratio ** (1 / max(1, self.refine_steps - 1))))

    @property
    def survival_rates(self) -> np.ndarray:
        """(n_layers,) target of each layer."""
        return np.linspace(self.first_survival, self.last_survival, self.n_layers)

    @property
    def layer_noise(self) -> np.ndarray:
        """(n_layers,) factor of sigma with which the particles of each layer are spread."""
        return self.noise * self.noise_decay ** np.arange(self.n_layers)
