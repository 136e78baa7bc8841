"""Search for the angles and lags of all cameras at which all pairs of them fit together.

With up and the person's places known from each camera alone (see `upright`), the pose of one camera
relative to another is an angle around the vertical. At the right angle and lag the planes through
both cameras that touch the silhouettes move alike (see `psfs.diagnostics.tangency`), and so does
the person on the floor. Steady differences do not count, since tilts are known to some degrees
only. A beam search combines the costs of all pairs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from psfs.cameras.camera import Camera, CameraRig
from psfs.diagnostics.tangency import NEAREST
from psfs.footage.camera_times import LEAST_OVERLAP, known_medians
from psfs.self_calibration.upright import FEWEST, UprightView

#: Noise of the person's places on the floor and of the touching planes' positions, statures.
_PLACES, _PLANES = 0.1, 0.006
#: Shortest line between two cameras, and the height of the person's middle, statures.
_SHORTEST, _MIDDLE = 0.2, 0.55
#: Lags with one translation, angles around the vertical that are tried, rad, and their rotations.
_STRIDE, _ANGLES = 5, 2 * np.pi * np.arange(36) / 36
_COSINES, _SINES = np.cos(_ANGLES), np.sin(_ANGLES)
_TURNS = np.stack([_COSINES, -_SINES, _SINES, _COSINES], -1).reshape(-1, 2, 2)
#: Partial arrangements that are kept, places that are tried of each camera, and steps of angle and
#: lag up to which arrangements are the same.
_KEPT, _BEST_PLACES, _SAME = 80, 12, 2


def compare_pair(first: UprightView, second: UprightView, most: int) -> np.ndarray:
    """Return the costs (A, 2 most + 1) of two cameras at all angles and lags.

    At an angle the second camera's axes are turned by it, counter-clockwise from above. At lag l,
    frame t of the first shows the time of frame t + l of the second. NaN where they cannot be
    compared. The translation is the same for `_STRIDE` consecutive lags.
    """
    costs = np.full((len(_TURNS), 2 * most + 1), np.nan)
    a, b = first.places, second.places
    fewest = max(FEWEST, int(LEAST_OVERLAP * min(len(a), len(b))))
    turned = b @ _TURNS.swapaxes(1, 2)
    for begin in range(0, 2 * most + 1, _STRIDE):
        lags = np.arange(begin, min(begin + _STRIDE, 2 * most + 1)) - most
        one, other = _overlap(a, b, int(lags[len(lags) // 2]))
        known = np.isfinite(one).all(1) & np.isfinite(other).all(1)
        if known.sum() < fewest:
            continue
        here, there = one[known].mean(0), other[known].mean(0)
        shifts = here - _TURNS @ there
        rows, planes = _planes((first, second), shifts, here)
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
        values = np.where(known, signal, np.nan)
        still.append(np.where(known, np.abs(values - known_medians(values, count)), 0.0))
    moving = np.maximum(still[0], still[1]).sum((-3, -1))
    total = count.sum((-3, -1))
    share = (still[2].sum((-3, -1)) + noise * total) / np.maximum(moving + noise * total, 1e-12)
    return np.where(total >= FEWEST, share, np.nan)


def _planes(
    views: tuple[UprightView, UprightView], shifts: np.ndarray, person: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray] | None]:
    """Return which of the turns can be compared (R,), and for these the positions (R, F,
    2) of the planes that touch either camera's silhouettes, statures at the person.

    Turns by which the line between the cameras passes too near to the person are left out; None if
    all are.
    """
    first, second = views
    rise = second.height - first.height
    lines = np.column_stack([shifts, np.full(len(shifts), rise)])
    lengths = np.linalg.norm(lines, axis=1)
    lines /= np.maximum(lengths, 1e-9)[:, None]
    middle = np.array([*person, _MIDDLE - first.height])
    ahead = middle - lines * (lines @ middle)[:, None]
    distances = np.linalg.norm(ahead, axis=1)
    rows = np.nonzero((lengths >= _SHORTEST) & (distances >= NEAREST))[0]
    if not len(rows):
        return rows, None
    lines, ahead, distances = lines[rows], ahead[rows], distances[rows, None]
    ahead = ahead / distances
    axes = np.stack([ahead, np.cross(lines, ahead)], -1)
    turned = axes.copy()
    turned[:, :2] = _TURNS[rows].swapaxes(1, 2) @ axes[:, :2]
    positions = []
    for view, directions in ((first, axes), (second, turned)):
        forward, across = (directions[..., side] @ view.rays.T for side in range(2))
        extremes = view.hulls.find_extreme_angles(forward, across)
        positions.append(distances[..., None] * extremes)
    return rows, (positions[0], positions[1])


#: Angle and lag of a camera, in steps of the tables.
Place = tuple[int, int]
#: Those of all cameras, relative to the first.
Arrangement = tuple[Place, ...]


class ArrangementSearch:
    """Costs of pairs (a, b), a < b, of V cameras: (A, 2 most + 1) each, see `compare_pair`. What
    cannot be compared has the median of all costs. Every camera has pairs with some that have pairs
    with camera 0."""

    def __init__(self, tables: Mapping[tuple[int, int], np.ndarray], n_cameras: int) -> None:
        known = np.concatenate([table[np.isfinite(table)] for table in tables.values()])
        self.neutral = float(np.median(known)) if len(known) else 1.0
        self.n_cameras = n_cameras
        self._tables: dict[tuple[int, int], np.ndarray] = {}
        for (a, b), table in tables.items():
            costs = np.where(np.isfinite(table), table, self.neutral)
            self._tables[a, b] = costs
            self._tables[b, a] = np.roll(costs[::-1], 1, axis=0)[:, ::-1]
        self.most = next(iter(tables.values())).shape[1] // 2

    def find(self, count: int) -> list[Arrangement]:
        """Return up to `count` different arrangements, the best first.

        Cameras are placed one after another, each at several places where it fits those before it
        best; the best partial arrangements are kept (beam search).
        """
        beam: list[tuple[float, dict[int, Place]]] = [(0.0, {0: (0, 0)})]
        for _ in range(1, self.n_cameras):
            view = self._choose_next(beam)
            grown = []
            for cost, places in beam:
                for more, place in self._best_places(view, places):
                    grown.append((cost + more, {**places, view: place}))
            grown.sort(key=lambda entry: entry[0])
            beam = self._keep_different(grown)
        return [self._describe(places) for _, places in beam[:count]]

    def move_one(self, arrangement: Arrangement, count: int) -> list[Arrangement]:
        """Return the arrangements in which one camera, each in turn, is at up to `count` of the
        other places where it fits the rest best."""
        places = dict(enumerate(arrangement))
        arrangements = []
        for view, current in places.items():
            others = {other: place for other, place in places.items() if other != view}
            tried = [(0.0, current), *self._best_places(view, others)]
            different = self._keep_different([(cost, {**others, view: at}) for cost, at in tried])
            arrangements += [self._describe(moved) for _, moved in different[1 : 1 + count]]
        return arrangements

    def _choose_next(self, beam: list[tuple[float, dict[int, Place]]]) -> int:
        """Return the camera whose place is clearest."""
        places = beam[0][1]
        compared = {
            view: [other for other in places if (other, view) in self._tables]
            for view in range(self.n_cameras)
            if view not in places
        }
        left = [view for view, others in compared.items() if others]
        return min(left, key=lambda v: float(self._costs(v, places).min()) / len(compared[v]))

    def _costs(self, view: int, places: Mapping[int, Place]) -> np.ndarray:
        """Return the costs (A, L) of a camera with those that are placed, summed."""
        total = np.zeros((len(_TURNS), 2 * self.most + 1))
        for other, (angle, lag) in places.items():
            if (other, view) not in self._tables:
                continue
            table = np.roll(self._tables[other, view], angle, axis=0)
            shifted = np.full_like(table, self.neutral)
            low, high = max(0, lag), min(table.shape[1], table.shape[1] + lag)
            if low < high:
                shifted[..., low:high] = table[..., low - lag : high - lag]
            total += shifted
        return total

    def _best_places(self, view: int, places: Mapping[int, Place]) -> list[tuple[float, Place]]:
        """Return the costs and places of the best local minima of `_costs`."""
        costs = self._costs(view, places)
        wide = np.pad(costs, ((2, 2), (0, 0)), mode="wrap")
        low = scipy.ndimage.minimum_filter(wide, (5, 5), mode="nearest")[2:-2]
        minima = np.argwhere(costs <= low)
        best: Any = minima[np.argsort(costs[tuple(minima.T)])[:_BEST_PLACES]].tolist()
        return [(float(costs[angle, lag]), (angle, lag - self.most)) for angle, lag in best]

    def _keep_different(
        self, grown: list[tuple[float, dict[int, Place]]]
    ) -> list[tuple[float, dict[int, Place]]]:
        different: list[tuple[float, dict[int, Place]]] = []
        taken: list[np.ndarray] = []
        for cost, places in grown:
            steps = np.array([places[view] for view in sorted(places)])
            if taken:
                apart = np.abs(np.array(taken) - steps)
                apart[..., 0] = np.minimum(apart[..., 0], len(_TURNS) - apart[..., 0])
                if (apart <= _SAME).all((1, 2)).any():
                    continue
            different.append((cost, places))
            taken.append(steps)
            if len(different) == _KEPT:
                break
        return different

    def _describe(self, places: Mapping[int, Place]) -> Arrangement:
        """Return the arrangement of all cameras."""
        ordered, first = [places[view] for view in range(self.n_cameras)], places[0]
        return tuple(((a - first[0]) % len(_TURNS), lag - first[1]) for a, lag in ordered)


def place_cameras(
    cameras: Sequence[Camera], views: Sequence[UprightView], arrangement: Arrangement,
    stature: float,
) -> CameraRig:  # fmt: skip
    """Place cameras by their upright views and arrangement, whose lags are in the views' frames.

    The first camera is above the origin, Z is its up; the stature, m, gives the scale.
    """
    placed, first = [], views[0].places
    for camera, view, (angle, lag) in zip(cameras, views, arrangement, strict=True):
        here, there = _overlap(first, view.places, lag)
        apart = here - there @ _TURNS[angle].T
        known = np.isfinite(apart).all(axis=1)
        shift = apart[known].mean(axis=0) if known.any() else np.zeros(2)
        world = np.eye(3)
        world[:2, :2] = _TURNS[angle]
        R = view.axes.T @ world.T
        placed.append(replace(camera, R=R, t=-R @ (stature * np.array([*shift, view.height]))))
    return CameraRig(tuple(placed))
