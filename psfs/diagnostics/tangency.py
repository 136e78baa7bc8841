"""Consistency of the silhouettes of many cameras, by epipolar tangency.

Two cameras and a point span an epipolar plane. The planes that touch a body touch its silhouettes
in both pictures, so both cameras must see the same two extreme planes (Sinha & Pollefeys, Camera
network calibration and synchronization from silhouettes in archived video, IJCV 87, 2010). This
needs only a few convex hulls, no voxels and no matched points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import intersect_axes_ahead, look_along_baseline
from psfs.diagnostics.hulls import HullPoints
from psfs.diagnostics.small_views import Outline

#: Cap of the differences between planes, as a share of the person's size: larger differences count
#: no more.
CAP = 0.1
#: Largest angle, rad, that the body may subtend around the line between two cameras; beyond it
#: their planes carry no information.
_WIDEST = 2.5
#: Pairs are left out if the line between the cameras passes the scene nearer than this share of the
#: person's size.
_NEAREST = 0.3
#: Signs of a picture's axes (x, y); -1 flips the axis.
Way = tuple[int, int]


@dataclass(frozen=True, eq=False)
class PairSums:
    """Sums and counts, (V, V) symmetric, of the capped differences of all pairs of cameras.

    `cost` is the mean: 0 is perfect, `CAP` the worst; NaN without any pair.
    """

    sums: np.ndarray
    counts: np.ndarray

    @property
    def cost(self) -> float:
        return _mean(self.sums, self.counts)

    @property
    def cameras(self) -> np.ndarray:
        """Mean (V,) of each camera's pairs."""
        return np.array([_mean(*of) for of in zip(self.sums, self.counts, strict=True)])

    def without(self, view: int) -> float:
        """Return the mean of all pairs but one camera's."""
        kept = np.delete(np.arange(len(self.sums)), view)
        return _mean(self.sums[np.ix_(kept, kept)], self.counts[np.ix_(kept, kept)])


class Tangency:
    """Comparison of outlines [frame][view] of F frames as seen by the cameras of `rig`.

    size: the person's, in the rig's unit: the median distance between the extreme planes, measured
    where the optical axes meet; NaN if no two cameras can be compared.
    """

    def __init__(self, rig: CameraRig, outlines: list[list[Outline | None]]) -> None:
        self.rig, self.n_frames = rig, len(outlines)
        self._images = [HullPoints([row[v] for row in outlines]) for v in range(len(rig))]
        self._target = intersect_axes_ahead(rig)
        self._planes: dict[tuple[int, int, int, Way], np.ndarray] = {}
        self._rays: dict[tuple[int, int, Way], np.ndarray] = {}
        self._axes: dict[tuple[int, int], tuple[np.ndarray, np.ndarray, float]] = {}
        spans = [
            np.nanmedian(np.diff(planes))
            for a in range(len(rig))
            for b in range(len(rig))
            if a != b and np.isfinite(np.diff(planes := self.planes(a, a, b))).any()
        ]
        self.size = float(np.median(spans)) if spans else float("nan")

    def planes(self, camera: int, image: int, other: int, way: Way = (1, 1)) -> np.ndarray:
        """Return the positions (F, 2) of the extreme planes through the line from `camera` to
        `other` that touch the outlines of `image`.

        Positions are measured at the scene, in the rig's unit. NaN if there is no outline, or if it
        touches the picture's border there. way: sign -1 flips the picture along that axis (x, y).
        """
        key = camera, image, other, way
        if key not in self._planes:
            rays = self.rays(camera, image, way)
            self._planes[key] = self._extreme_planes(image, rays, camera, other)
        return self._planes[key]

    def rays(self, camera: int, image: int, way: Way = (1, 1)) -> np.ndarray:
        """Return the directions (N, 3) of all points of an image's outlines."""
        key = camera, image, way
        if key not in self._rays:
            own, points = self.rig[camera], self._images[image].pixels
            turned = np.where(np.less(way, 0), np.array(own.size) - 1 - points, points)
            self._rays[key] = own.rays(turned) if len(points) else np.zeros((0, 3))
        return self._rays[key]

    def compare(
        self,
        order: Sequence[int] | None = None,
        shifts: Sequence[int] | None = None,
        mirrored: Sequence[int] = (),
        turned: Sequence[int] = (),
        base: PairSums | None = None,
    ) -> PairSums:
        """Compare all pairs under an assumption: camera v has the pictures of camera order[v],
        shifts[v] frames later than the others, those of `mirrored` cameras flipped left to right,
        those of `turned` ones upside down. base: of the same order and shifts without flips; only
        pairs of flipped cameras are compared again."""
        n = len(self.rig)
        order, shifts = order or range(n), shifts or [0] * n
        ways = {**dict.fromkeys(mirrored, (-1, 1)), **dict.fromkeys(turned, (-1, -1))}
        sums, counts = np.zeros((n, n)), np.zeros((n, n))
        if base is not None:
            sums, counts = base.sums.copy(), base.counts.copy()
        for a in range(n):
            for b in range(a):
                known = base is not None and a not in ways and b not in ways
                if known or not self.comparable(a, b):
                    continue
                first = self.planes(a, order[a], b, ways.get(a, (1, 1)))
                second = self.planes(b, order[b], a, ways.get(b, (1, 1)))
                pair = self.difference(first, second, shifts[b] - shifts[a])
                sums[a, b], counts[a, b] = pair
                sums[b, a], counts[b, a] = pair
        return PairSums(sums, counts)

    def foreign_motion(self, view: int) -> tuple[float, float]:
        """Return the share of the motion that a camera does not have in common with the others, and
        that share among the others.

        It is the sum over frames and pairs of what their planes differ by beyond the median, which
        a wrong calibration explains, as a share of the planes' own motion: about 1 for cameras that
        film different things, however they are placed. NaN if nothing moves.
        """
        sums = np.zeros((2, 2))  # of this camera's pairs, and of the others'; differing, moving
        for a in range(len(self.rig)):
            for b in range(a):
                if self.comparable(a, b):
                    own = self.planes(a, a, b), self.planes(b, b, a)
                    sums[int(view not in (a, b))] += _differing_motion(*own)
        with np.errstate(divide="ignore", invalid="ignore"):
            own, others = sums[:, 0] / sums[:, 1]
        return float(own), float(others)

    def comparable(self, a: int, b: int) -> bool:
        """Return whether the line between two cameras passes far enough from the scene."""
        return self._axis(a, b)[2] >= _NEAREST * self.size

    def difference(self, a: np.ndarray, b: np.ndarray, lag: int = 0) -> tuple[float, int]:
        """Return sum and number of the differences of planes (F, 2), each at most `CAP`, as shares
        of the person's size. Frame t of a is compared with frame t + lag of b."""
        first, end = max(0, -lag), min(len(a), len(b) - lag)
        if end <= first:
            return 0.0, 0
        apart = (a[first:end] - b[first + lag : end + lag]) / max(self.size, 1e-12)
        known = np.isfinite(apart)
        return float(np.minimum(np.abs(apart[known]), CAP).sum()), int(known.sum())

    def differences(
        self, a: np.ndarray, b: np.ndarray, most: int, steady: bool, cap: float
    ) -> np.ndarray:
        """Return (2 most + 1, 2) sums and numbers at all lags from -most to most, each difference
        at most `cap`. Without `steady`, the part that is the same in all frames is subtracted: it
        comes from a wrong calibration, not from a lag."""
        around = np.pad(b.T, ((0, 0), (most, most)), constant_values=np.nan)
        shifted = np.lib.stride_tricks.sliding_window_view(around, len(a), axis=1)
        apart = (a.T[:, None] - shifted) / max(self.size, 1e-12)  # (2, lags, F)
        counts = np.isfinite(apart).sum(-1)
        if not steady:
            apart -= _medians(apart, counts)[..., None]
        sums = np.nansum(np.minimum(np.abs(apart), cap), axis=-1)
        return np.column_stack([sums.sum(0), counts.sum(0)])

    def measure_turned(self, camera: int, rotation: np.ndarray) -> float:
        """Return the cost of one camera's pairs after its rays were turned by `rotation` (3, 3)."""
        rays, total, count = self.rays(camera, camera) @ rotation.T, 0.0, 0
        for other in range(len(self.rig)):
            if other == camera or not self.comparable(camera, other):
                continue
            mine = self._extreme_planes(camera, rays, camera, other)
            pair = self.difference(mine, self.planes(other, other, camera))
            total, count = total + pair[0], count + pair[1]
        return total / count if count else float("nan")

    def _axis(self, a: int, b: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Return two directions perpendicular to the line between two cameras, the first towards
        the scene, and the scene's distance from the line."""
        pair = min(a, b), max(a, b)
        if pair not in self._axes:
            first, second = (self.rig[view] for view in pair)
            _, axes, distance = look_along_baseline(first, second, self._target)
            self._axes[pair] = axes[:, 0], axes[:, 1], distance
        return self._axes[pair]

    def _extreme_planes(self, image: int, rays: np.ndarray, camera: int, other: int) -> np.ndarray:
        first, second, distance = self._axis(camera, other)
        angles = np.arctan2(rays @ second, rays @ first)
        return distance * self._images[image].extremes(angles, _WIDEST)


def _medians(values: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return the medians (...) of values (..., n), of which `counts` (...) are not NaN."""
    ordered, counts = np.sort(values), np.maximum(counts, 1)[..., None]
    low, high = (np.take_along_axis(ordered, k, -1) for k in ((counts - 1) // 2, counts // 2))
    return 0.5 * (low + high)[..., 0]


def _differing_motion(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """Return by how much the motions of planes (F, 2) differ, and how much they move."""
    known = np.isfinite(a) & np.isfinite(b)
    total = np.zeros(2)
    for column, there in enumerate(known.T):
        if there.any():
            one, other = (of[there, column] - np.median(of[there, column]) for of in (a, b))
            apart = (a - b)[there, column]
            moving = np.maximum(np.abs(one), np.abs(other)).sum()
            total += np.abs(apart - np.median(apart)).sum(), moving
    return float(total[0]), float(total[1])


def _mean(sums: np.ndarray, counts: np.ndarray) -> float:
    return float(sums.sum() / counts.sum()) if counts.sum() else float("nan")
