"""How large a search a frame's time allows."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from apf.filters.method import Method

#: With fewer evaluations a search does not follow a person; with more it gains nothing.
FEWEST, MOST = 960, 6000
#: Sizes to choose from, each about half as large again as the one before.
_N_SIZES = 6
#: Particles come in multiples of this, and there are at least so many.
_STEP, _FEWEST_PARTICLES = 16, 48
_FEWEST_LAYERS, _MOST_LAYERS = 6, 15
#: Share of the layers in which an annealed particle filter moves the trunk alone.
_TRUNK_SHARE = 1 / 3
#: Share of a frame's time that is planned with.
_SHARE = 0.85
#: The size is chosen anew when the median of so many frames is this far from what is allowed.
_WINDOW, _TOO_LONG, _WITH_ROOM = 8, 1.2, 0.7


def sized(method: Method, evaluations: float) -> Method:
    """`method` with particles and layers for about so many evaluations of a frame.

    Ten layers for a thousand evaluations, fewer below, more above: a swarm with fewer than six
    does not converge (Rymut 2016, figure 6.9), beyond fifteen it gains little.
    """
    layers = int(np.clip(round(np.sqrt(evaluations / 10)), _FEWEST_LAYERS, _MOST_LAYERS))
    if method.search == "sir":
        layers = 1
    particles = max(_FEWEST_PARTICLES, round(evaluations / layers / _STEP) * _STEP)
    size = {"n_particles": particles, "n_layers": layers}
    if method.search == "apf":
        size["trunk_layers"] = round(_TRUNK_SHARE * layers)
    return replace(method, filter=replace(method.filter, **size))


def sizes(method: Method) -> list[Method]:
    """`method` in the sizes to choose from, ascending."""
    return [sized(method, count) for count in np.geomspace(FEWEST, MOST, _N_SIZES)]


def evaluations(method: Method) -> int:
    """How often a frame's search scores a pose."""
    return method.filter.n_particles * method.filter.n_layers


class Governor:
    """Chooses among searches the largest that leaves frames in time.

    costs: s that each search takes, ascending. period: s that a frame may take. overlaps: frames
    are processed while others are searched in, else before. generous: a search may take as long as
    the processing does, though the period be exceeded: where processing alone takes too long,
    smaller searches would hardly make frames faster. `place`: the search chosen.
    """

    def __init__(
        self,
        period: float,
        costs: Sequence[float],
        processing: float,
        *,
        overlaps: bool = False,
        generous: bool = False,
    ) -> None:
        self.period, self.costs = period, np.maximum.accumulate(costs)
        self._overlaps, self._generous = overlaps, generous
        self._slower: deque[float] = deque(maxlen=_WINDOW)
        self.place = self._largest(self.allowed(processing), 1.0)

    def allowed(self, processing: float) -> float:
        """s that a search may take beside so many s of processing."""
        left = _SHARE * self.period - (0.0 if self._overlaps else processing)
        return max(left, processing) if self._generous else left

    def revised(self, processing: float, seconds: float) -> bool:
        """After a frame processed in about `processing` s and searched in for `seconds`: is another
        search chosen?"""
        self._slower.append(seconds / self.costs[self.place])
        if len(self._slower) < _WINDOW:
            return False
        slower, allowed = float(np.median(self._slower)), self.allowed(processing)
        before, taken = self.place, slower * self.costs[self.place]
        if taken > _TOO_LONG * allowed:
            self.place = self._largest(allowed, slower)
        else:
            self.place = max(before, self._largest(_WITH_ROOM * allowed, slower))
        if self.place != before:
            self._slower.clear()
        return self.place != before

    def _largest(self, allowed: float, slower: float) -> int:
        """The largest search within `allowed` s where all take `slower` times their cost."""
        return max(0, int(np.count_nonzero(slower * self.costs <= allowed)) - 1)
