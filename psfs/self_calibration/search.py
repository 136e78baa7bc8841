"""Search for the angles and lags of all cameras at which all pairs fit together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from psfs.cameras.camera import Camera, CameraRig
from psfs.self_calibration.upright import UprightView

#: Number of angles around the vertical that are tried.
N_ANGLES = 36
#: Partial arrangements that are kept, places that are tried of each camera, and steps of angle and
#: lag up to which arrangements are the same.
_KEPT, _BEST_PLACES, _SAME = 80, 12, 2


@dataclass(frozen=True)
class Arrangement:
    """Variants of all cameras, their angles and lags relative to the first, in steps of the tables,
    and the mean cost of all pairs."""

    variants: tuple[int, ...]
    angles: tuple[int, ...]
    lags: tuple[int, ...]
    cost: float


#: Variant, angle and lag of a camera.
Place = tuple[int, int, int]


class ArrangementSearch:
    """Costs of pairs (a, b), a < b, of V cameras: (T, T, A, 2 most + 1) each, of T variants of
    either camera, see `compare_pair`. What cannot be compared has the median of all costs. Every
    camera has pairs with some that have pairs with camera 0."""

    def __init__(self, tables: Mapping[tuple[int, int], np.ndarray], n_cameras: int) -> None:
        known = np.concatenate([table[np.isfinite(table)] for table in tables.values()])
        self.neutral = float(np.median(known)) if len(known) else 1.0
        self.n_cameras = n_cameras
        self._tables: dict[tuple[int, int], np.ndarray] = {}
        for (a, b), table in tables.items():
            costs = np.where(np.isfinite(table), table, self.neutral)
            self._tables[a, b] = costs
            back = np.roll(costs[:, :, ::-1], 1, axis=2)[..., ::-1]
            self._tables[b, a] = back.swapaxes(0, 1)
        shape = next(iter(tables.values())).shape
        self.n_angles, self.most = shape[2], shape[3] // 2

    def find(self, count: int) -> list[Arrangement]:
        """Return up to `count` different arrangements, the best first.

        Cameras are placed one after another, each at several places where it fits those before it
        best; the best partial arrangements are kept (beam search).
        """
        variants = range(next(iter(self._tables.values())).shape[0])
        beam: list[tuple[float, dict[int, Place]]] = [(0.0, {0: (own, 0, 0)}) for own in variants]
        for _ in range(1, self.n_cameras):
            view = self._choose_next(beam)
            grown = []
            for cost, places in beam:
                for more, place in self._best_places(view, places):
                    grown.append((cost + more, {**places, view: place}))
            grown.sort(key=lambda of: of[0])
            beam = self._keep_different(grown)
        return [self._describe(places) for _, places in beam[:count]]

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
        """Return the costs (T, A, L) of a camera with those that are placed, summed."""
        total = np.zeros(next(iter(self._tables.values())).shape[1:])
        for other, (variant, angle, lag) in places.items():
            if (other, view) not in self._tables:
                continue
            table = np.roll(self._tables[other, view][variant], angle, axis=1)
            shifted = np.full_like(table, self.neutral)
            low, high = max(0, lag), min(table.shape[2], table.shape[2] + lag)
            if low < high:
                shifted[..., low:high] = table[..., low - lag : high - lag]
            total += shifted
        return total

    def _best_places(self, view: int, places: Mapping[int, Place]) -> list[tuple[float, Place]]:
        """Return the costs and places of the best local minima of `_costs`."""
        costs = self._costs(view, places)
        best = costs.min(axis=0)
        wide = np.pad(best, ((2, 2), (0, 0)), mode="wrap")
        low = scipy.ndimage.minimum_filter(wide, (5, 5), mode="nearest")[2:-2]
        angles, lags = np.nonzero(best <= low)
        order = np.argsort(best[angles, lags])[:_BEST_PLACES]
        found = []
        for angle, lag in zip(angles[order].tolist(), lags[order].tolist(), strict=True):
            variant = int(costs[:, angle, lag].argmin())
            found.append((float(best[angle, lag]), (variant, angle, lag - self.most)))
        return found

    def _keep_different(
        self, grown: list[tuple[float, dict[int, Place]]]
    ) -> list[tuple[float, dict[int, Place]]]:
        kept: list[tuple[float, dict[int, Place]]] = []
        taken: list[np.ndarray] = []
        for cost, places in grown:
            own = np.array([places[view][1:] for view in sorted(places)])
            if taken:
                apart = np.abs(np.array(taken) - own)
                apart[..., 0] = np.minimum(apart[..., 0], self.n_angles - apart[..., 0])
                if (apart <= _SAME).all((1, 2)).any():
                    continue
            kept.append((cost, places))
            taken.append(own)
            if len(kept) == _KEPT:
                break
        return kept

    def _describe(self, places: Mapping[int, Place]) -> Arrangement:
        """Return the arrangement of all cameras."""
        total, pairs = 0.0, [(a, b) for a, b in self._tables if a < b]
        for a, b in pairs:
            angle = (places[b][1] - places[a][1]) % self.n_angles
            lag = places[b][2] - places[a][2] + self.most
            inside = 0 <= lag <= 2 * self.most
            own = self._tables[a, b][places[a][0], places[b][0], angle]
            total += float(own[lag]) if inside else self.neutral
        views, first = range(self.n_cameras), places[0]
        return Arrangement(
            tuple(places[view][0] for view in views),
            tuple((places[view][1] - first[1]) % self.n_angles for view in views),
            tuple(places[view][2] - first[2] for view in views),
            total / len(pairs),
        )


def place_cameras(
    cameras: Sequence[Camera], views: Sequence[UprightView], angles: np.ndarray,
    lags: Sequence[int], stature: float,
) -> CameraRig:  # fmt: skip
    """Place cameras by their upright views, angles (V,) rad and lags, in the views' frames.

    The first camera is above the origin, Z is its up; the stature, m, gives the scale.
    """
    placed, first = [], views[0].places
    for camera, view, angle, lag in zip(cameras, views, angles, lags, strict=True):
        cosine, sine = np.cos(angle), np.sin(angle)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        begin, end = max(0, -lag), max(0, -lag, min(len(first), len(view.places) - lag))
        apart = first[begin:end] - view.places[begin + lag : end + lag] @ turn.T
        known = np.isfinite(apart).all(axis=1)
        shift = apart[known].mean(axis=0) if known.any() else np.zeros(2)
        world = np.eye(3)
        world[:2, :2] = turn
        R = view.axes.T @ world.T
        placed.append(replace(camera, R=R, t=-R @ (stature * np.array([*shift, view.height]))))
    return CameraRig(tuple(placed))
