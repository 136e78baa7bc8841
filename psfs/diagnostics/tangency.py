"""Consistency of the silhouettes of many cameras, by epipolar tangency.

Two cameras and a point span an epipolar plane. The planes that touch a body touch its silhouettes
in both pictures, so both cameras must see the same two extreme planes (Sinha & Pollefeys, Camera
network calibration and synchronization from silhouettes in archived video, IJCV 87, 2010). This
needs only a few convex hulls, no voxels and no matched points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import intersect_axes_ahead, look_along_baseline
from psfs.diagnostics.hulls import HullRays
from psfs.diagnostics.small_views import Outline
from psfs.footage.camera_times import (
    BLOCKS,
    CameraTimes,
    PairCosts,
    compare_signals,
    estimate_times,
    mean_costs,
)

#: Cap of the differences between planes, as a share of the person's size: larger differences count
#: no more.
CAP = 0.1
#: Largest angle, rad, that the body may subtend around the line between two cameras; beyond it
#: their planes carry no information.
_WIDEST = 2.5
#: Pairs are left out if the line between the cameras passes the scene nearer than this share of the
#: person's size.
_NEAREST = 0.3
#: Differences of planes up to this are noise, as a share of the person's size: silhouettes of
#: somebody who keeps still agree at any offset.
NOISE = 0.003
#: Signs of a picture's axes (x, y); -1 flips the axis.
AxisSigns = tuple[int, int]


@dataclass(frozen=True, eq=False)
class PairSums:
    """Sums and counts, (B, V, V) symmetric, of the capped differences of all pairs of cameras in B
    stretches of frames.

    `cost` is the mean: 0 is perfect, `CAP` the worst; NaN without any pair.
    """

    sums: np.ndarray
    counts: np.ndarray

    @property
    def cost(self) -> float:
        return float(_divide(self.sums.sum(), self.counts.sum()))

    @property
    def blocks(self) -> np.ndarray:
        """Mean (B,) of each stretch of frames; NaN without any pair."""
        return _divide(self.sums.sum((1, 2)), self.counts.sum((1, 2)))

    @property
    def cameras(self) -> np.ndarray:
        """Mean (V,) of each camera's pairs."""
        return _divide(self.sums.sum((0, 1)), self.counts.sum((0, 1)))

    def without(self, view: int) -> float:
        """Return the mean of all pairs but one camera's; NaN without any."""
        kept = np.delete(np.arange(self.sums.shape[1]), view)
        rest = np.ix_(np.arange(len(self.sums)), kept, kept)
        return float(_divide(self.sums[rest].sum(), self.counts[rest].sum()))

    def measure_gain(self, after: PairSums, views: Sequence[int]) -> np.ndarray:
        """Return by which share the cost of the pairs of `views` is less after a change.

        One value (B,) for each stretch of frames: the jackknife's pseudo-values, whose mean is the
        gain and whose spread tells its deviation.
        """
        rows = np.zeros(self.sums.shape[1], bool)
        rows[list(views)] = True
        pairs = np.triu(rows[:, None] | rows[None], 1)
        both = np.stack([self.sums, self.counts, after.sums, after.counts])[..., pairs].sum(-1)
        both = both[:, both[1] > 0]
        every, count = both.sum(1), both.shape[1]
        rest = every[:, None] - both if count > 1 else both

        def gain(of: np.ndarray) -> np.ndarray:
            return 1 - _divide(_divide(of[2], of[3]), _divide(of[0], of[1]))

        return np.asarray(count * gain(every) - (count - 1) * gain(rest))


def _divide(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(a / b)


class Tangency:
    """Comparison of outlines [frame][view] of F frames as seen by the cameras of `rig`.

    size: the person's, in the rig's unit: the median distance between the extreme planes, measured
    where the optical axes meet; NaN if no two cameras can be compared.
    """

    def __init__(self, rig: CameraRig, outlines: list[list[Outline | None]]) -> None:
        self.rig, self.outlines, self.n_frames = rig, outlines, len(outlines)
        self._images = [
            HullRays(camera, [row[v] for row in outlines]) for v, camera in enumerate(rig)
        ]
        self._target = intersect_axes_ahead(rig)
        self._planes: dict[tuple[int, int, int, AxisSigns], np.ndarray] = {}
        self._rays: dict[tuple[int, int, AxisSigns], np.ndarray] = {}
        self._axes: dict[tuple[int, int], tuple[np.ndarray, np.ndarray, float]] = {}
        spans = [
            np.nanmedian(np.diff(planes))
            for a in range(len(rig))
            for b in range(len(rig))
            if a != b and np.isfinite(np.diff(planes := self.planes(a, a, b))).any()
        ]
        self.size = float(np.median(spans)) if spans else float("nan")

    def planes(self, camera: int, image: int, other: int, way: AxisSigns = (1, 1)) -> np.ndarray:
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

    def rays(self, camera: int, image: int, way: AxisSigns = (1, 1)) -> np.ndarray:
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
        mirrored: Sequence[int] = (),
        turned: Sequence[int] = (),
        base: PairSums | None = None,
    ) -> PairSums:
        """Compare all pairs under an assumption: camera v has the pictures of camera order[v],
        those of `mirrored` cameras flipped left to right,
        those of `turned` ones upside down. base: of the same order without flips; only
        pairs of flipped cameras are compared again."""
        order = order or range(len(self.rig))
        ways = {**dict.fromkeys(mirrored, (-1, 1)), **dict.fromkeys(turned, (-1, -1))}

        def planes(camera: int, other: int) -> np.ndarray:
            return self.planes(camera, order[camera], other, ways.get(camera, (1, 1)))

        return self._compare_pairs(planes, None if base is None else list(ways), base)

    def turn(self, camera: int, rotation: np.ndarray) -> PairSums:
        """Compare the pairs of one camera after its rays were turned by `rotation` (3, 3)."""
        rays = self.rays(camera, camera) @ rotation.T

        def planes(view: int, other: int) -> np.ndarray:
            if view == camera:
                return self._extreme_planes(camera, rays, camera, other)
            return self.planes(view, view, other)

        return self._compare_pairs(planes, [camera])

    def _compare_pairs(
        self,
        planes: Callable[[int, int], np.ndarray],
        views: Sequence[int] | None = None,
        base: PairSums | None = None,
    ) -> PairSums:
        """Compare the planes (F, 2) of pairs of cameras: of all, or of those with one of `views`;
        the others are those of `base`."""
        n = len(self.rig)
        sums, counts = np.zeros((BLOCKS, n, n)), np.zeros((BLOCKS, n, n))
        if base is not None:
            sums, counts = base.sums.copy(), base.counts.copy()
        for a, b in combinations(range(n), 2):
            if (views is None or a in views or b in views) and self.comparable(a, b):
                apart, there = self._difference(planes(a, b), planes(b, a))
                sums[:, a, b] = sums[:, b, a] = apart
                counts[:, a, b] = counts[:, b, a] = there
        return PairSums(sums, counts)

    def comparable(self, a: int, b: int) -> bool:
        """Return whether the line between two cameras passes far enough from the scene."""
        return self._axis(a, b)[2] >= _NEAREST * self.size

    def measure_times(self, most: int) -> CameraTimes:
        """Estimate the cameras' offsets of up to `most` frames from the motion of their planes."""
        costs = self._compare_motions(2 * most) if most > 1 else {}
        return estimate_times(len(self.rig), costs, noise=NOISE)

    def measure_offset_costs(self, most: int) -> np.ndarray:
        """Return (V, 2 most + 1) the mean difference of each camera's planes from the others' if
        its pictures came later by -most to most frames."""
        sums = np.zeros((len(self.rig), 2 * most + 1, 2))
        for (a, b), table in self._compare_motions(most).items():
            sums[b] += table.sum(axis=1)
            sums[a] += table.sum(axis=1)[::-1]
        return np.stack([mean_costs(own[:, None]) for own in sums])

    def _compare_motions(self, most: int) -> PairCosts:
        """Return the costs of the pairs of cameras at offsets of up to `most` frames."""
        costs: dict[tuple[int, int], np.ndarray] = {}
        for a, b in combinations(range(len(self.rig)), 2):
            if self.comparable(a, b):
                pair = self.planes(a, a, b) / self.size, self.planes(b, b, a) / self.size
                table = compare_signals(*pair, most, CAP)
                if table[..., 1].any():
                    costs[a, b] = table
        return costs

    def _difference(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return sums and numbers (B,) of the differences of planes (F, 2), each at most `CAP`, as
        shares of the person's size, in stretches of frames."""
        apart = np.abs(a - b) / max(self.size, 1e-12)
        known = np.isfinite(apart)
        starts = np.linspace(0, len(a), min(BLOCKS, len(a)) + 1).astype(int)[:-1]
        parts = np.where(known, np.minimum(apart, CAP), 0).sum(1), known.sum(1)
        sums, counts = np.zeros(BLOCKS), np.zeros(BLOCKS)
        sums[: len(starts)], counts[: len(starts)] = (np.add.reduceat(x, starts) for x in parts)
        return sums, counts

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
