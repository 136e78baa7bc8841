"""Settings of a filter, made of those of its parts: search, likelihood, refinement, limb search.

"Tuned" says that a default was the best of those tried, over several seeds; "by hand" that it was
set once and not tried against others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING, Any

from pydantic import model_validator

from apf.likelihood.config import KeypointConfig, LikelihoodConfig
from cl import InputError
from psfs.common.config import Config, fields_below, nonnegative, part, setting

if TYPE_CHECKING:
    import numpy as np

#: Frame rate, 1/s, that the sigmas of body models are stated for.
SIGMA_FPS = 60.0
#: Distances at which the cost of the refinement is half its maximum (Geman & McClure 1987): of a
#: voxel, m, about its edge; of an observed point, in standard deviations.
VOXEL_SCALE, POINT_SCALE = 0.03, 2.5


class SearchConfig(Config):
    """The particles and the layers in which they are annealed."""

    n_particles: int = setting(
        200,
        "Number of particles.",
        "Song et al. section 4",
        least=2,
        most=1_000_000,
        flag="--particles",
        flag_help="particles",
    )
    n_layers: int = setting(
        10,
        "Number of annealing layers, or of a swarm's iterations.",
        "Song et al. section 4",
        least=1,
        most=1000,
        flag="--layers",
        flag_help="annealing layers, or the swarm's iterations",
    )
    first_survival: float = setting(
        0.5,
        "Share of the particles, as effective sample size, that the exponent beta of the first "
        "layer leaves; above 1 / `n_particles`.",
        "Deutscher & Reid 2005, who take 0.5 in every layer",
        above=0,
        below=1,
    )
    last_survival: float = setting(
        0.05,
        "The same share of the last layer; linear in between.",
        "by hand: the mean is that of the best particles",
        above=0,
        below=1,
    )
    noise: float = setting(
        0.35,
        "Standard deviation of the first layer's noise.",
        "tuned with the refinement behind it",
        "of the body's sigmas",
        above=0,
        below=100,
        flag="--noise",
        flag_help="scale of the noise",
    )
    noise_decay: float = setting(
        0.8,
        "Factor of the noise from layer to layer.",
        "by hand: a tenth is left after ten layers",
        above=0,
        below=100,
    )
    velocity: float = setting(
        0.5,
        "Share of the last change by which the next frame's particles are shifted, and its weight "
        "in the root's mean velocity: 0 for Song et al. eq. (13), 1 for constant velocity.",
        "tuned: legs are not swapped at low frame rates",
        least=0,
        most=1000,
    )
    trunk_layers: int = setting(
        3,
        "Number of first layers that move the trunk alone (partitioned sampling, MacCormick & "
        "Isard 2000).",
        "tuned",
        least=0,
        most=1000,
        flag="--trunk-layers",
        flag_help="apf: first layers that move the trunk alone",
    )
    seed: int = setting(
        0,
        "Seed of the random numbers: the same seed gives the same track.",
        "any",
        least=0,
        most=2**64 - 1,
        flag="--seed",
        flag_help="seed of the noise; the same seed gives the same track",
    )

    @model_validator(mode="after")
    def _some_survive(self) -> SearchConfig:
        for name in ("first_survival", "last_survival"):
            rate = getattr(self, name)
            if not rate > 1 / self.n_particles:
                raise InputError(
                    f"n_particles is {self.n_particles}; expected more than {1 / rate:g}, of which "
                    f"a share of {name} = {rate} survives"
                )
        return self

    @property
    def survival_rates(self) -> np.ndarray:
        """(n_layers,) target of each layer."""
        import numpy as np

        return np.linspace(self.first_survival, self.last_survival, self.n_layers)

    @property
    def layer_noise(self) -> np.ndarray:
        """(n_layers,) factor of sigma with which the particles of each layer are spread."""
        import numpy as np

        return self.noise * self.noise_decay ** np.arange(self.n_layers)


@dataclass(frozen=True)
class GaussNewtonFit:
    """A fit by Gauss-Newton: its steps, the prior's standard deviation about the particles' mean in
    parts of the first layer's noise, and the scale of the observed points' weights in the first
    step, in standard deviations. It shrinks to `POINT_SCALE`, as that of the voxels shrinks from
    twice `VOXEL_SCALE` (graduated non-convexity, Blake & Zisserman 1987)."""

    steps: int
    width: float
    point_reach: float

    @property
    def reaches(self) -> list[tuple[float, float]]:
        """The reach of voxels, m, and of observed points, in deviations, in every step and after
        the last one."""

        def shrink_to(scale: float, reach: float) -> list[float]:
            shrink = min(1.0, (scale / reach) ** (1 / max(1, self.steps - 1)))
            reaches = [reach]
            for _ in range(self.steps):
                reaches.append(max(scale, reaches[-1] * shrink))
            return reaches

        voxels = shrink_to(VOXEL_SCALE, 2 * VOXEL_SCALE)
        return list(zip(voxels, shrink_to(POINT_SCALE, self.point_reach), strict=True))


class RefinementConfig(Config):
    """Gauss-Newton steps of the estimate against the surface voxels and observed points."""

    steps: int = nonnegative(
        4,
        "Number of steps; 0 for no refinement and no limb search.",
        "tuned: a fifth one changes nothing",
    )


class LimbSearchConfig(Config):
    """The search for limbs elsewhere, before a frame's estimate is final."""

    reach: float = nonnegative(
        16.0,
        "Distance within which limbs are searched, beside a search anywhere within their "
        "limits; 0 turns the limb search off.",
        "tuned",
        "of the body's sigmas",
    )

    least_recall: float = nonnegative(
        2.0,
        "Least weight of the silhouette recall when the best poses are compared, because both "
        "legs may lie in the silhouette of one.",
        "tuned",
    )

    @property
    def reaches(self) -> list[float]:
        """Spread of the poses in each round, in the body's sigmas. Each further round looks around
        the best poses of the previous one, half as wide, down to one sigma: few random poses have
        the forearm in its outline."""
        rounds = max(0, math.ceil(math.log2(max(self.reach, 1))))
        return [self.reach * 0.5**i for i in range(1 + rounds)]


class FilterConfig(Config):
    """All settings of a filter.

    `FilterConfig.create(n_particles=100, limb_search_reach=0.0)` sets single ones: those of search
    and likelihood by their own names, those of the smaller parts after the part's.
    """

    search: SearchConfig = part(SearchConfig)
    likelihood: LikelihoodConfig = part(LikelihoodConfig)
    refinement: RefinementConfig = part(RefinementConfig)
    limb_search: LimbSearchConfig = part(LimbSearchConfig)
    keypoints: KeypointConfig = part(KeypointConfig)

    @classmethod
    def create(cls, **settings: Any) -> FilterConfig:
        """Return the defaults, except for single `settings`. Raises InputError for bad values and
        TypeError for unknown names."""
        return cls().with_changes(**settings)

    def with_changes(self, **settings: Any) -> FilterConfig:
        """Return a copy of these settings with single ones changed, named as in `create`."""
        unknown = sorted(settings.keys() - _PATHS.keys())
        if unknown:
            raise TypeError(f"no setting of a filter: {', '.join(unknown)}")
        values: dict[str, Any] = {}
        for name, value in settings.items():
            *parts, last = _PATHS[name]
            table = values
            for path in parts:
                table = table.setdefault(path, {})
            table[last] = value
        return self.overlay(values)

    @property
    def settings(self) -> dict[str, Any]:
        """Every single setting by its name in `create`."""
        return {name: reduce(getattr, path, self) for name, path in _PATHS.items()}

    @property
    def fit(self) -> GaussNewtonFit:
        """The refinement; its prior reaches as far as the particles do."""
        return GaussNewtonFit(self.refinement.steps, width=4.0, point_reach=4 * POINT_SCALE)

    @property
    def point_fit(self) -> GaussNewtonFit:
        """The fit that moves limbs to observed points: with errors of about 250 px, and a prior
        about as wide as the motion of a limb in a few frames."""
        return GaussNewtonFit(steps=6, width=40.0, point_reach=60.0)

    @property
    def searches_limbs(self) -> bool:
        """Whether the limb search runs before an estimate is final."""
        return self.limb_search.reach > 0 and self.refinement.steps > 0

    def scale_to_rate(self, fps: float) -> FilterConfig:
        """Return the settings for `fps` frames/s: deviations that are stated for 60 frames/s grow
        with the time between frames."""
        return self.with_changes(noise=self.search.noise * SIGMA_FPS / fps)


#: Parts whose settings have names of their own; those of all others begin with the part's.
_UNPREFIXED = ("search", "likelihood")


#: The path of names to each single setting, by the setting's name in `FilterConfig.create`.
_PATHS = {
    path[-1] if path[-2] in _UNPREFIXED else "_".join(path[-2:]): path
    for path, _ in fields_below(FilterConfig)
}
