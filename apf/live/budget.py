"""Choice of the largest search that fits into the time per frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from apf.filters.method import Method
from apf.live.config import GovernorConfig, SizeConfig


def resize_search(method: Method, evaluations: float, config: SizeConfig | None = None) -> Method:
    """Return `method` with particles and layers for about `evaluations` per frame.

    Ten layers for a thousand evaluations, fewer below, more above: a swarm with fewer than six does
    not converge (Rymut 2016, figure 6.9), and beyond fifteen it gains little.
    """
    config = config or SizeConfig()
    layers = round(np.sqrt(evaluations / 10))
    layers = int(np.clip(layers, config.min_layers, config.max_layers))
    if method.search == "sir":
        layers = 1
    step = config.particle_step
    particles = max(config.min_particles, round(evaluations / layers / step) * step)
    size = {"n_particles": particles, "n_layers": layers}
    if method.search == "apf":
        size["trunk_layers"] = round(config.trunk_share * layers)
    return method.replace(filter=method.filter.with_changes(**size))


def list_sizes(method: Method, config: SizeConfig | None = None) -> list[Method]:
    """Return `method` in all sizes to choose from, ascending."""
    config = config or SizeConfig()
    counts = np.geomspace(config.fewest, config.most, config.n_sizes)
    return [resize_search(method, count, config) for count in counts]


class Governor:
    """Selects the largest search that keeps up with the frame rate.

    costs: s that each search takes, ascending. period: s available per frame. overlaps: the next
    frame is processed during a search, else before it. generous: a search may take as long as the
    processing, even if the period is exceeded; if the processing alone takes too long, smaller
    searches would hardly raise the frame rate. `chosen`: index of the selected search.
    """

    def __init__(
        self,
        period: float,
        costs: Sequence[float],
        processing: float,
        *,
        overlaps: bool = False,
        generous: bool = False,
        config: GovernorConfig | None = None,
    ) -> None:
        self._config = config or GovernorConfig()
        self.period, self.costs = period, np.maximum.accumulate(costs)
        self._overlaps, self._generous = overlaps, generous
        self._slower: deque[float] = deque(maxlen=self._config.window)
        self.chosen = self._largest(self.search_time(processing), 1.0)

    def search_time(self, processing: float) -> float:
        """Return the time, s, available for a search if the processing takes `processing` s."""
        left = self._config.share * self.period - (0.0 if self._overlaps else processing)
        return max(left, processing) if self._generous else left

    def update(self, processing: float, seconds: float) -> bool:
        """Update the selection after a frame that was processed in about `processing` s and
        searched in `seconds`; return whether the selection changed."""
        self._slower.append(seconds / self.costs[self.chosen])
        if len(self._slower) < self._config.window:
            return False
        slower, allowed = float(np.median(self._slower)), self.search_time(processing)
        before, taken = self.chosen, slower * self.costs[self.chosen]
        if taken > self._config.too_long * allowed:
            self.chosen = self._largest(allowed, slower)
        else:
            roomy = self._largest(self._config.with_room * allowed, slower)
            self.chosen = max(before, roomy)
        if self.chosen != before:
            self._slower.clear()
        return self.chosen != before

    def _largest(self, allowed: float, slower: float) -> int:
        """Return the largest search within `allowed` s if all take `slower` times their cost."""
        return max(0, int(np.count_nonzero(slower * self.costs <= allowed)) - 1)
