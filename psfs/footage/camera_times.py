"""When each camera took its pictures, from whichever evidence there is.

Two kinds of evidence tell the offset between two cameras: costs at every whole offset (of signals
that both show, such as silhouettes, keypoints or the height of a head), and offsets measured with
a deviation (sound). `CameraTimes` finds the whole offsets of the greatest likelihood by costs,
and measures fractions around these; `combine_offsets` combines measured ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import scipy

#: Independent measurements per frame: in neighbouring frames silhouettes and keypoints err alike.
INDEPENDENT_SHARE = 0.1
#: Least share of the frames that must be left at an offset: a few fit at any.
LEAST_OVERLAP = 0.4
#: Stretches of frames by which an offset is tested, and interleaved parts that these make up.
BLOCKS, _FOLDS = 10, 5
#: Greatest share by which a camera's clock runs differently.
MOST_DRIFT = 0.01
#: Variance, frames^2, of an offset that no evidence tells.
_UNKNOWN = 1e6

#: Evidence of pairs of cameras (a, b): sums and numbers of differences (2 most + 1, B, 2) at
#: offsets of -most to most frames by which b's pictures come later, in B stretches of frames.
PairCosts = Mapping[tuple[int, int], np.ndarray]


@dataclass(frozen=True)
class MeasuredOffset:
    """The pictures of camera `b` come `offset` frames later than those of `a`, to a standard
    deviation of `sigma` frames."""

    a: int
    b: int
    offset: float
    sigma: float


class CameraTimes:
    """The times of V cameras, estimated from the costs of offsets between pairs.

    noise: mean difference up to which signals agree. Differences are taken to be Laplace
    distributed with an unknown scale, so the log-likelihood of an offset is -n log(mean + noise).

    offsets: (V,) frames by which each camera's pictures come later than the median camera's.
    sigmas: (V,) their standard deviations, frames. chances: (V,) probability that as many of
    five interleaved parts of the frames have their best offset within one frame of this one, if
    each is best at any offset alike, as parts are that tell nothing; 1 without an offset.
    """

    def __init__(self, n_cameras: int, costs: PairCosts, noise: float = 1e-9) -> None:
        tables = {pair: _measure_likelihood(table, noise) for pair, table in costs.items()}
        whole = _choose_whole_offsets(n_cameras, tables)
        self.offsets, self.sigmas = combine_offsets(n_cameras, _measure_fractions(tables, whole))
        self.chances = np.ones(n_cameras)
        for view in np.flatnonzero(whole):
            if any(view in pair for pair in tables):
                self.chances[view] = _test_offset(int(view), whole, costs, tables)

    @property
    def whole(self) -> list[int]:
        """The offsets (V,) in whole frames."""
        return [round(float(offset)) for offset in self.offsets]


def shift_points(points: np.ndarray, lag: int) -> np.ndarray:
    """Return points (F, ...) of which frame t is the given frame t + lag; NaN where none is."""
    out = np.full_like(points, np.nan)
    begin, end = max(0, -lag), len(points) - max(0, lag)
    if begin < end:
        out[begin:end] = points[begin + lag : end + lag]
    return out


def compare_signals(a: np.ndarray, b: np.ndarray, most: int, cap: float) -> np.ndarray:
    """Compare signals (F, K) of two cameras, NaN where unknown; return `PairCosts` of the absolute
    differences, each at most `cap`.

    What differs in all frames alike comes from the calibration and not from the time: the
    differences with or without their median are used, whichever fit better.
    """
    padded = np.pad(b.T, ((0, 0), (most, most)), constant_values=np.nan)
    shifted = np.lib.stride_tricks.sliding_window_view(padded, len(a), axis=1)
    differences = a.T[:, None] - shifted  # (K, offsets, F)
    steady = known_medians(differences, np.isfinite(differences).sum(-1, keepdims=True))
    tried = [sum_costs(of, cap) for of in (differences, differences - np.nan_to_num(steady))]
    return min(tried, key=lambda table: float(np.nanmin(mean_costs(table), initial=np.inf)))


def sum_costs(differences: np.ndarray, cap: float) -> np.ndarray:
    """Return `PairCosts` of differences (K, 2 most + 1, F), NaN where unknown, each at most `cap`
    in size."""
    n, known = differences.shape[-1], np.isfinite(differences)
    starts = np.unique(np.linspace(0, n, min(BLOCKS, n) + 1).astype(int))[:-1]
    sizes = np.where(known, np.minimum(np.abs(differences), cap), 0)
    sums, counts = (np.add.reduceat(of.sum(0), starts, axis=1) for of in (sizes, known))
    return np.stack([sums, counts], -1)


def mean_costs(table: np.ndarray) -> np.ndarray:
    """Return the mean differences (L,) of `PairCosts` (L, B, 2); NaN where too few are left."""
    sums, counts = table.sum(axis=1).T
    enough = counts > LEAST_OVERLAP * counts.max(initial=1)
    return np.where(enough, sums / np.maximum(counts, 1), np.nan)


def combine_offsets(
    n_cameras: int, measured: Iterable[MeasuredOffset]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the offsets (V,), frames, whose median is 0, that fit measured ones best by weighted
    least squares, and their standard deviations (V,)."""
    normal, right = np.eye(n_cameras) / _UNKNOWN, np.zeros(n_cameras)
    for row in measured:
        difference = np.zeros(n_cameras)
        difference[[row.a, row.b]] = -1, 1
        normal += np.outer(difference, difference) / row.sigma**2
        right += difference * row.offset / row.sigma**2
    covariance = np.linalg.inv(normal)
    offsets = covariance @ right
    centred = np.eye(n_cameras) - 1 / n_cameras
    spread = np.diag(centred @ covariance @ centred)
    return offsets - np.median(offsets), np.sqrt(np.maximum(spread, 0))


def known_medians(values: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return the medians (..., 1) of values (..., n), of which `counts` (..., 1) are not NaN; of
    many rows in a seventh of `np.nanmedian`'s time."""
    ordered, counts = np.sort(values), np.maximum(counts, 1)
    low, high = (np.take_along_axis(ordered, k, -1) for k in ((counts - 1) // 2, counts // 2))
    return 0.5 * (low + high)


def _measure_likelihood(table: np.ndarray, noise: float) -> np.ndarray:
    """Return the negative log-likelihoods (L,) of `PairCosts` (L, B, 2); where too few frames are
    left, that of the worst offset."""
    known = mean_costs(table)
    worst = np.nanmax(known) if np.isfinite(known).any() else 1.0
    n = INDEPENDENT_SHARE * float(table[..., 1].sum(axis=1).max())
    return n * np.log(np.where(np.isfinite(known), known, worst) + noise)


def _choose_whole_offsets(
    n_cameras: int, tables: Mapping[tuple[int, int], np.ndarray]
) -> np.ndarray:
    """Return the whole offsets (V,) of the greatest likelihood, whose median is 0.

    From no offsets and from the offsets to each camera in turn, one camera after another is moved
    while that helps. A camera whose offset would be the longest that was tried gets none.
    """
    most = max((len(table) // 4 for table in tables.values()), default=0)
    starts = [np.zeros(n_cameras, int)]
    for root in range(n_cameras):
        offsets = np.zeros(n_cameras, int)
        for a, b in tables:
            if root in (a, b):
                least = int(tables[a, b].argmin()) - len(tables[a, b]) // 2
                offsets[a + b - root] = offsets[root] + (least if root == a else -least)
        starts.append(np.clip(offsets, -most, most))
    span = np.arange(-most, most + 1)
    best = starts[0], np.inf
    for offsets in starts if tables else ():
        cost = np.inf
        while True:
            for view in range(n_cameras):
                curve = _sum_curves(view, offsets, span, tables)
                offsets[view] = span[int(curve.argmin())]
            pairs = tables.items()
            total = float(sum(_look_up(t, offsets[b] - offsets[a]) for (a, b), t in pairs))
            if not total < cost:
                break
            cost = total
        if cost < best[1]:
            best = offsets.copy(), cost
    whole = best[0] - round(float(np.median(best[0])))
    return np.where(np.abs(whole) < max(most, 1), whole, 0)


def _sum_curves(
    view: int,
    offsets: np.ndarray,
    span: np.ndarray,
    tables: Mapping[tuple[int, int], np.ndarray],
) -> np.ndarray:
    """Return the negative log-likelihoods (L,) of a camera's offsets `span` (L,)."""
    curve = np.zeros(len(span))
    for (a, b), table in tables.items():
        if view in (a, b):
            curve += _look_up(table, span - offsets[a] if view == b else offsets[b] - span)
    return curve


def _look_up(table: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Return the values of a table (2 most + 1,) at offsets; those of the ends beyond them."""
    most = len(table) // 2
    return np.asarray(table[np.clip(offsets, -most, most) + most])


def _measure_fractions(
    tables: Mapping[tuple[int, int], np.ndarray], whole: np.ndarray
) -> list[MeasuredOffset]:
    """Return the offsets of pairs at the minimum of the parabola through the costs around whole
    offsets (V,); pairs without a minimum there tell nothing."""
    found = []
    for (a, b), table in tables.items():
        middle = int(whole[b] - whole[a]) + len(table) // 2
        if not 1 <= middle < len(table) - 1:
            continue
        before, here, after = table[middle - 1 : middle + 2]
        bend = before - 2 * here + after
        aside = 0.5 * (before - after) / bend if bend > 0 else np.inf
        if abs(aside) <= 1:
            offset = float(whole[b] - whole[a]) + aside
            found.append(MeasuredOffset(a, b, offset, float(1 / np.sqrt(bend))))
    return found


def _test_offset(
    view: int, whole: np.ndarray, costs: PairCosts, tables: Mapping[tuple[int, int], np.ndarray]
) -> float:
    """Return the probability of `CameraTimes.chances` of one camera's offset."""
    own = {pair: costs[pair] for pair in tables if view in pair}
    most = max(len(table) for table in own.values()) // 4
    span = np.arange(-most, most + 1)
    agreeing = 0
    for fold in range(_FOLDS):
        part = {pair: _measure_likelihood(of[:, fold::_FOLDS], 1e-9) for pair, of in own.items()}
        curve = _sum_curves(view, whole, span, part)
        agreeing += bool(np.ptp(curve) > 0) and abs(span[int(curve.argmin())] - whole[view]) <= 1
    # One of them agrees because the offset was estimated from it, too.
    return float(scipy.special.bdtrc(agreeing - 2, _FOLDS - 1, 3 / len(span)))
