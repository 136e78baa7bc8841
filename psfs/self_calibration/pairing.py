"""How well two cameras' silhouettes fit at every angle between the cameras and every lag.

With up and the person's places known from each camera alone (see `upright`), the pose of one camera
relative to another is an angle around the vertical. At the right angle and lag the planes through
both cameras that touch the silhouettes move alike (see `psfs.diagnostics.tangency`), and so does
the person on the floor. Steady differences do not count, since tilts are known to some degrees
only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from psfs.diagnostics.hulls import HullRays
from psfs.self_calibration.upright import FEWEST, UprightView

#: Noise of the person's places on the floor and of the touching planes' positions, statures.
_PLACES, _PLANES = 0.1, 0.006
#: Least share of the shorter recording that two cameras must have in common.
_SHARE = 0.3
#: Shortest line between two cameras, its least distance from the person, and the height of the
#: person's middle, statures.
_SHORTEST, _NEAREST, _MIDDLE = 0.2, 0.3, 0.55


@dataclass(frozen=True, eq=False)
class Walker:
    """The person in one camera: the upright view, and the hulls with their rays (N, 3) in the
    floor's axes."""

    view: UprightView
    hulls: HullRays
    rays: np.ndarray

    @classmethod
    def create(cls, view: UprightView, hulls: HullRays) -> Walker:
        return cls(view, hulls, hulls.rays @ view.axes.T)


def compare_pair(
    first: Walker, second: Walker, angles: np.ndarray, most: int, stride: int = 5
) -> np.ndarray:  # fmt: skip
    """Return the costs (A, 2 most + 1) of two cameras at all angles (A,), rad, and lags.

    At an angle the second camera's axes are turned by it, counter-clockwise from above. At lag l,
    frame t of the first shows the time of frame t + l of the second. NaN where they cannot be
    compared. The translation is the same for `stride` consecutive lags.
    """
    costs = np.full((len(angles), 2 * most + 1), np.nan)
    a, b = first.view.places, second.view.places
    fewest = max(FEWEST, int(_SHARE * min(len(a), len(b))))
    cosine, sine = np.cos(angles), np.sin(angles)
    turns = np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], -2)
    turned = b @ turns.swapaxes(1, 2)
    for begin in range(0, 2 * most + 1, stride):
        lags = np.arange(begin, min(begin + stride, 2 * most + 1)) - most
        one, other = _overlap(a, b, int(lags[len(lags) // 2]))
        known = np.isfinite(one).all(1) & np.isfinite(other).all(1)
        if known.sum() < fewest:
            continue
        here, there = one[known].mean(0), other[known].mean(0)
        shifts = here - turns @ there
        rows, planes = _planes((first, second), turns, shifts, here)
        if planes is None:
            continue
        costs[rows, begin : begin + len(lags)] = differing_shares(
            a[None], turned[rows] + shifts[rows, None], lags, _PLACES
        ) + differing_shares(*planes, lags, _PLANES)
    return costs


def _overlap(a: np.ndarray, b: np.ndarray, lag: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of `a` and `b` of the same times: row t of a, row t + lag of b."""
    first, end = max(0, -lag), max(0, -lag, min(len(a), len(b) - lag))
    return a[first:end], b[first + lag : end + lag]


def differing_shares(a: np.ndarray, b: np.ndarray, lags: np.ndarray, noise: float) -> np.ndarray:
    """Return (..., L) by how much the motions of signals (..., F, K) and (..., G, K) differ at
    consecutive lags (L,), as a share of the motions themselves; 1 without motion, NaN with fewer
    than `FEWEST` frames."""
    first, end = max(0, -int(lags[0])), min(a.shape[-2], b.shape[-2] - int(lags[-1]))
    if end - first < FEWEST:
        return np.full((*np.broadcast_shapes(a.shape[:-2], b.shape[:-2]), len(lags)), np.nan)
    one = a[..., first:end, :].swapaxes(-1, -2)[..., None, :]
    windows = np.lib.stride_tricks.sliding_window_view(b, end - first, axis=-2)
    start = first + int(lags[0])
    other = windows[..., start : start + len(lags), :, :].swapaxes(-2, -3)
    apart = one - other
    known = np.isfinite(apart)
    count = known.sum(-1, keepdims=True)
    still = []
    for signal in (one, other, apart):
        own = np.where(known, signal, np.nan)
        still.append(np.where(known, np.abs(own - _medians(own, count)), 0.0))
    moving = np.maximum(still[0], still[1]).sum((-3, -1))
    total = count.sum((-3, -1))
    share = (still[2].sum((-3, -1)) + noise * total) / np.maximum(moving + noise * total, 1e-12)
    return np.where(total >= FEWEST, share, np.nan)


def _medians(values: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Return the upper medians (..., 1) of values (..., F), of which count (..., 1) are not NaN."""
    return np.take_along_axis(np.sort(values), np.minimum(count // 2, values.shape[-1] - 1), -1)


def _planes(
    walkers: tuple[Walker, Walker], turns: np.ndarray, shifts: np.ndarray, person: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray] | None]:  # fmt: skip
    """Return which of the turns (A, 2, 2) can be compared (R,), and for these the positions (R, F,
    2) of the planes that touch either camera's silhouettes, statures at the person.

    Turns by which the line between the cameras passes too near to the person are left out; None if
    all are.
    """
    first, second = walkers
    rise = second.view.height - first.view.height
    lines = np.column_stack([shifts, np.full(len(shifts), rise)])
    lengths = np.linalg.norm(lines, axis=1)
    lines /= np.maximum(lengths, 1e-9)[:, None]
    middle = np.array([*person, _MIDDLE - first.view.height])
    ahead = middle - lines * (lines @ middle)[:, None]
    distances = np.linalg.norm(ahead, axis=1)
    rows = np.nonzero((lengths >= _SHORTEST) & (distances >= _NEAREST))[0]
    if not len(rows):
        return rows, None
    lines, ahead, distances = lines[rows], ahead[rows], distances[rows, None]
    ahead = ahead / distances
    axes = np.stack([ahead, np.cross(lines, ahead)], -1)
    turned = axes.copy()
    turned[:, :2] = turns[rows].swapaxes(1, 2) @ axes[:, :2]
    found = []
    for walker, own in ((first, axes), (second, turned)):
        forward, across = (own[..., side] @ walker.rays.T for side in range(2))
        extremes = walker.hulls.find_extreme_angles(forward, across)
        found.append(distances[..., None] * extremes)
    return rows, (found[0], found[1])
