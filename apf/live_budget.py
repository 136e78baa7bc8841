"""How many particles and iterations a frame's time allows."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from apf.methods import Method

#: With fewer evaluations a search does not follow a person; with more it gains nothing.
FEWEST, MOST = 960, 6000
#: Particles come in multiples of this, and there are at least so many.
_STEP, _FEWEST_PARTICLES = 16, 48
_FEWEST_LAYERS, _MOST_LAYERS = 6, 15
#: Share of a frame's time that is planned with.
_SHARE = 0.85
#: A search is resized when the median of so many frames is this far from the plan.
_WINDOW, _TOO_LONG, _TOO_SHORT = 10, 1.1, 0.6


def sized(method: Method, evaluations: float) -> Method:
    """`method` with particles and layers for about so many evaluations of a frame.

    Ten layers for a thousand evaluations, fewer below, more above: a swarm with fewer than six
    does not converge (Rymut 2016, figure 6.9), beyond fifteen it gains little.
    """
    layers = int(np.clip(round(np.sqrt(evaluations / 10)), _FEWEST_LAYERS, _MOST_LAYERS))
    if method.search == "sir":
        layers = 1
    particles = max(_FEWEST_PARTICLES, round(evaluations / layers / _STEP) * _STEP)
    return replace(method, filter=replace(method.filter, n_particles=particles, n_layers=layers))


def evaluations(method: Method) -> int:
    """How often a frame's search scores a pose."""
    return method.filter.n_particles * method.filter.n_layers


@dataclass(frozen=True)
class Cost:
    """A search's time: `fixed` s per frame and `each` s per evaluation."""

    fixed: float
    each: float

    @classmethod
    def of(cls, counts: tuple[int, int], seconds: tuple[float, float]) -> Cost:
        """From two searches of so many evaluations each."""
        each = max((seconds[1] - seconds[0]) / (counts[1] - counts[0]), 1e-9)
        return cls(max(seconds[0] - each * counts[0], 0.0), each)

    def allows(self, seconds: float) -> float:
        """Evaluations that fit, within FEWEST and MOST."""
        return float(np.clip((seconds - self.fixed) / self.each, FEWEST, MOST))


class Governor:
    """Keeps a search within `period` s per frame: a plan from its cost, then by what it took."""

    def __init__(self, period: float, cost: Cost) -> None:
        self.period, self.cost = period, cost
        self._taken: deque[float] = deque(maxlen=_WINDOW)

    def plan(self, method: Method) -> Method:
        """The method, sized to the period."""
        return sized(method, self.cost.allows(_SHARE * self.period))

    def revised(self, method: Method, seconds: float) -> Method | None:
        """After a frame that took so long: another size, or None to go on as before."""
        self._taken.append(seconds)
        if len(self._taken) < _WINDOW:
            return None
        median, count = float(np.median(self._taken)), evaluations(method)
        if _TOO_SHORT * self.period < median < _TOO_LONG * self.period:
            return None
        each = max(median - self.cost.fixed, 0.1 * median) / count
        self.cost = replace(self.cost, each=each)
        other = self.plan(method)
        if evaluations(other) == count:
            return None
        self._taken.clear()
        return other
