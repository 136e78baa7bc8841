"""Match things one to one, and choose a state for every frame."""

from __future__ import annotations

import numpy as np
import scipy

#: More than any cost.
_FAR = 1e6


def match_pairs(costs: np.ndarray, limit: float = _FAR) -> list[tuple[int, int]]:
    """Return the pairs (row, column) of least total cost (Hungarian method), each in one pair at
    most, of those with a cost below `limit`.

    costs: (N, M); infinite or NaN where two cannot be a pair.
    """
    if not costs.size:
        return []
    possible = np.isfinite(costs) & (costs < limit)
    pairs = zip(*scipy.optimize.linear_sum_assignment(np.where(possible, costs, _FAR)), strict=True)
    return [(int(row), int(column)) for row, column in pairs if possible[row, column]]


def find_best_path(costs: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Return the sequence of states (F,) of least total cost (Viterbi 1967).

    costs: (F, K) of each state; infinite where it cannot be. changes: (F - 1, K, K) of the
    transition from one state to another.
    """
    n_frames, total = len(costs), costs[0].copy()
    come_from = np.zeros(costs.shape, int)
    for frame in range(1, n_frames):
        reached = total[:, None] + changes[frame - 1]
        come_from[frame] = reached.argmin(0)
        total = reached.min(0) + costs[frame]
    path = np.empty(n_frames, int)
    path[-1] = total.argmin()
    for frame in range(n_frames - 1, 0, -1):
        path[frame - 1] = come_from[frame, path[frame]]
    return path
