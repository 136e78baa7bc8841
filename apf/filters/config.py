"""Settings of a filter, made of those of its parts: search, likelihood, refinement, limb search.

"Tuned" says that a default was the best of those tried on the synthetic walks (4 and 8 cameras) and
the recordings at hand, over several seeds; "by hand" that it was set once and not tried against
others.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

import numpy as np

from apf.likelihood.config import KeypointConfig, LikelihoodConfig
from apf.likelihood.terms import TERMS as REGISTERED
from cl import InputError
from psfs.common.ranges import check_range

#: Frame rate, 1/s, that the sigmas of body models are stated for.
SIGMA_FPS = 60.0


@dataclass(frozen=True)
class SearchConfig:
    """The particles and the layers in which they are annealed."""

    n_particles: int = 200
    """Particles. Song et al. section 4."""
    n_layers: int = 10
    """Annealing layers; iterations of a swarm. Song et al. section 4."""
    first_survival: float = 0.5
    """Effective sample size over number of particles that the exponent beta of the first layer
    reaches (Deutscher & Reid 2005, who take 0.5 in every layer)."""
    last_survival: float = 0.05
    """That of the last layer; linear in between. By hand: the mean is of the best particles."""
    noise: float = 0.35
    """Deviation of the first layer's noise, in the body's sigmas. Tuned on nine sequences, with the
    refinement behind it."""
    noise_decay: float = 0.8
    """Its factor from layer to layer. By hand: a tenth is left after ten layers."""
    spread: float = 0.0
    """Where positive, noise after the first layer is at most this times the set's own deviation
    (Deutscher & Reid 2005). Off: it did not help with so few particles."""
    velocity: float = 0.5
    """Share of the last change that is expected again: 0 for Song et al. eq. (13), 1 for constant
    velocity. Tuned: no legs are swapped at low frame rates."""
    trunk_layers: int = 3
    """So many first layers move the trunk alone (partitioned sampling, MacCormick & Isard 2000).
    Tuned on nine sequences."""
    seed: int = 0
    """Of the random numbers, 0 to 2^64 - 1: the same seed gives the same track."""

    def __post_init__(self) -> None:
        check_range("n_particles", self.n_particles, 2, 1_000_000, ends=True)
        check_range("n_layers", self.n_layers, 1, 1000, ends=True)
        if not 0 <= self.seed < 2**64:
            raise InputError(f"the seed is {self.seed}; expected 0 to 2^64 - 1")
        for name in ("first_survival", "last_survival"):
            rate = getattr(self, name)
            if not 1 / self.n_particles < rate < 1:
                raise InputError(
                    f"{name} is {rate}; expected between 1 / n_particles = "
                    f"{1 / self.n_particles:.3g} and 1"
                )
        for name in ("noise", "noise_decay"):
            check_range(name, getattr(self, name), 0, 100)
        for name in ("spread", "velocity", "trunk_layers"):
            check_range(name, getattr(self, name), 0, 1000, ends=True)

    @property
    def survival_rates(self) -> np.ndarray:
        """(n_layers,) target of each layer."""
        return np.linspace(self.first_survival, self.last_survival, self.n_layers)

    @property
    def layer_noise(self) -> np.ndarray:
        """(n_layers,) factor of sigma with which the particles of each layer are spread."""
        return self.noise * self.noise_decay ** np.arange(self.n_layers)


@dataclass(frozen=True)
class RefinementConfig:
    """Gauss-Newton steps of the estimate against the surface voxels."""

    steps: int = 4
    """Steps; 0 for no refinement and no limb search. Tuned: a fifth one changes nothing."""
    scale: float = 0.03
    """m, distance at which a voxel is half unexplained in the cost (Geman & McClure 1987). By hand:
    about a voxel."""
    reach: float = 0.06
    """m, the scale that voxels are weighed by in the first step; it shrinks to `scale`, so that
    those far from any cone pull first (graduated non-convexity, Blake & Zisserman 1987). By
    hand."""
    strength: float = 1350.0
    """Weight of the voxels' mean cost against the prior's squared distance. By hand."""
    width: float = 4.0
    """Deviation of the prior about the particles' mean, in the first layer's noise. By hand: as far
    as the particles reach."""
    point_strength: float = 1.0
    """Weight of each observed point's squared distance, in deviations, against the prior's: 1 where
    their errors have nothing to do with each other."""
    point_scale: float = 2.5
    """Deviations at which an observed point is half missed."""
    point_reach: float = 10.0
    """Deviations that observed points are weighed by in the first step; they shrink to
    `point_scale`, as `reach` does."""

    def __post_init__(self) -> None:
        check_range("refinement_steps", self.steps, 0, ends=True)
        names = ("scale", "reach", "strength", "width", "point_strength", "point_scale",
                 "point_reach")  # fmt: skip
        for name in names:
            check_range(f"refinement_{name}", getattr(self, name), 0)

    @property
    def reaches(self) -> list[tuple[float, float]]:
        """The reach of voxels, m, and of observed points, in deviations, in every step and after
        the last one."""

        def shrinking(reach: float, scale: float) -> list[float]:
            shrink = min(1.0, (scale / reach) ** (1 / max(1, self.steps - 1)))
            found = [reach]
            for _ in range(self.steps):
                found.append(max(scale, found[-1] * shrink))
            return found

        voxels = shrinking(self.reach, self.scale)
        return list(zip(voxels, shrinking(self.point_reach, self.point_scale), strict=True))


@dataclass(frozen=True)
class LimbSearchConfig:
    """The search for limbs elsewhere, before a frame's estimate is final."""

    reach: float = 16.0
    """Limbs are looked for within up to so many of the body's sigmas, and anywhere within their
    limits; 0 for not at all. Tuned on the synthetic walks."""
    rounds: int = 4
    """Rounds that look about the best of the round before, each half as far. Tuned on
    synth_box_4cam and synth_salsa_4cam_hd: without them arms that were lost were seldom found
    again, for few poses that are anywhere have a forearm where its outlines are."""
    round_reach: float = 8.0
    """Deviation in the first of these rounds, in the body's sigmas. Tuned with them."""
    near_margin: float = 0.01
    """Share by which the error must fall for a limb to be moved within that reach. Tuned."""
    far_margin: float = 0.05
    """Share by which it must fall for a limb to be moved anywhere. Tuned: with 0.03 limbs were
    moved that had been right."""
    least_recall: float = 2.0
    """Least weight of the silhouette recall when the best are compared: two legs may hide in the
    silhouette of one. Tuned on the synthetic walks."""
    point_steps: int = 6
    """Gauss-Newton steps by observed points alone, whose pose of each limb is among those tried."""
    point_reach: float = 60.0
    """Deviations that observed points are weighed by in the first of them: about 250 px."""
    point_width: float = 40.0
    """Deviation of the prior about the mean in these, in the first layer's noise: as far as a limb
    swings in a few frames."""

    def __post_init__(self) -> None:
        for name in ("reach", "rounds", "near_margin", "far_margin", "least_recall"):
            check_range(f"limb_search_{name}", getattr(self, name), 0, ends=True)
        check_range("limb_search_point_steps", self.point_steps, 1, ends=True)
        for name in ("round_reach", "point_reach", "point_width"):
            check_range(f"limb_search_{name}", getattr(self, name), 0)

    @property
    def reaches(self) -> list[float]:
        """How far the poses of every round reach, in the body's sigmas."""
        return [self.reach, *(self.round_reach * 0.5**i for i in range(self.rounds))]


@dataclass(frozen=True)
class FilterConfig:
    """All settings of a filter.

    `FilterConfig.of(n_particles=100, surface_weight=2.0, limb_search_reach=0.0)` sets single ones:
    those of search and likelihood by their own names, those of the smaller parts after the part's.
    """

    search: SearchConfig = field(default_factory=SearchConfig)
    likelihood: LikelihoodConfig = field(default_factory=LikelihoodConfig)
    refinement: RefinementConfig = field(default_factory=RefinementConfig)
    limb_search: LimbSearchConfig = field(default_factory=LimbSearchConfig)
    keypoints: KeypointConfig = field(default_factory=KeypointConfig)

    @classmethod
    def of(cls, **settings: Any) -> FilterConfig:
        """Return the defaults but for single `settings`. Raises InputError for bad values and
        TypeError for unknown names."""
        return cls().changed(**settings)

    def changed(self, **settings: Any) -> FilterConfig:
        """Return these settings but for single ones, named as in `of`."""
        unknown = sorted(settings.keys() - self.settings.keys())
        if unknown:
            raise TypeError(f"no setting of a filter: {', '.join(unknown)}")
        changed: FilterConfig = _changed(self, "", settings)
        return changed

    @property
    def settings(self) -> dict[str, Any]:
        """Every single setting by its name in `of`."""
        return dict(_listed(self, ""))

    @property
    def by_points(self) -> FilterConfig:
        """The settings of the refinement that brings limbs to observed points."""
        search = self.limb_search
        return self.changed(
            refinement_steps=search.point_steps, refinement_point_reach=search.point_reach,
            refinement_width=search.point_width,
        )  # fmt: skip

    @property
    def searches_limbs(self) -> bool:
        """Whether limbs are looked for elsewhere before an estimate is final."""
        return self.limb_search.reach > 0 and self.refinement.steps > 0

    def at_rate(self, fps: float) -> FilterConfig:
        """Return the settings for `fps` frames/s: deviations that are stated for 60 frames/s grow
        with the time between frames."""
        longer, settings = SIGMA_FPS / fps, self.settings
        growing = ["noise", *(f"{t.name}_{s}" for t in REGISTERED.values() for s in t.per_interval)]
        return self.changed(**{name: settings[name] * longer for name in growing})


#: Parts whose settings have names of their own; those of all others begin with the part's.
_UNPREFIXED = ("search", "likelihood", "reprojection", "samples")


def _inner(part_name: str) -> str:
    return "" if part_name in _UNPREFIXED else f"{part_name}_"


def _listed(part: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """Yield name and value of every single setting of a config."""
    for entry in fields(part):
        value = getattr(part, entry.name)
        if is_dataclass(value):
            yield from _listed(value, _inner(entry.name))
        else:
            yield prefix + entry.name, value


def _changed(part: Any, prefix: str, settings: dict[str, Any]) -> Any:
    """Return a config with those of `settings` whose names are its own and its parts'."""
    values = {}
    for entry in fields(part):
        value = getattr(part, entry.name)
        if is_dataclass(value):
            values[entry.name] = _changed(value, _inner(entry.name), settings)
        elif prefix + entry.name in settings:
            values[entry.name] = settings[prefix + entry.name]
    return replace(part, **values)


def _usual_terms() -> dict[str, str]:
    """Return the settings that weigh the terms which are on by default, by the term's name."""
    default = LikelihoodConfig()
    return {
        "edge": "edge_weight",
        "silhouette": "silhouette_weight",
        "surface": "surface_weight",
        "overlap": "overlap_weight",
        "posture": "posture_prior_weight",
        **{name: f"{name}_weight" for name in default.terms},
        "pictures": "foreground_join_on",
    }


def _other_terms() -> dict[str, tuple[str, float]]:
    """Return those of the other terms, with the weight that they have when they are chosen by name.
    Silhouette recall weighs as in the limb search; keypoints by hand."""
    usual = LikelihoodConfig().terms
    others = {t.name: (f"{t.name}_weight", t.chosen_weight) for t in REGISTERED.values()}
    return {
        "silhouette_recall": ("silhouette_recall_weight", 2.0),
        **{name: weighed for name, weighed in others.items() if name not in usual},
        "keypoints": ("keypoints_weight", 4.0),
    }


_USUAL_TERMS, _OTHER_TERMS = _usual_terms(), _other_terms()
#: The setting with which keypoints count, where they are chosen in another way.
KEYPOINTS_ON = dict([_OTHER_TERMS["keypoints"]])
USUAL_TERMS = tuple(_USUAL_TERMS)
TERMS = (*USUAL_TERMS, *_OTHER_TERMS)


def likelihood_weights(text: str) -> dict[str, float]:
    """Return the settings of a FilterConfig for `edge,silhouette=2`: these terms with their default
    weights or the stated ones, all others 0, in the limb search, too.

    Raises InputError for unknown terms and bad weights.
    """
    defaults = FilterConfig().settings
    usual = {term: (name, defaults[name]) for term, name in _USUAL_TERMS.items()} | _OTHER_TERMS
    weights = {name: type(weight)(0) for name, weight in usual.values()}
    weights["limb_search_least_recall"] = 0.0
    for entry in text.split(","):
        term, _, value = entry.partition("=")
        if term not in TERMS:
            raise InputError(f"likelihood {text!r}: no term {term!r}; expected {', '.join(TERMS)}")
        name, weight = usual[term]
        try:
            weights[name] = type(weight)(float(value or weight))
        except ValueError:
            raise InputError(f"likelihood {text!r}: {value!r} is no weight of {term}") from None
    return weights
