"""Consistency of the silhouettes of many cameras, by epipolar tangency.

Two cameras and a point span an epipolar plane. The planes that touch a body touch its silhouettes
in both pictures, so both cameras must see the same two extreme planes (Sinha & Pollefeys, Camera
network calibration and synchronization from silhouettes in archived video, IJCV 87, 2010). This
needs only a few convex hulls, no voxels and no matched points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import intersect_axes_ahead, look_along_baseline
from psfs.common.numbers import jackknife
from psfs.diagnostics.hulls import HullRays
from psfs.diagnostics.small_views import Outline
from psfs.footage.camera_times import (
    BLOCKS,
    CameraTimes,
    PairCosts,
    compare_signals,
    mean_costs,
    sum_costs,
)

#: Cap of the differences between planes, as a share of the person's size: larger differences count
#: no more.
CAP = 0.1
#: Largest angle, rad, that the body may subtend around the line between two cameras; beyond it
#: their planes carry no information.
_WIDEST = 2.5
#: Pairs are left out if the line between the cameras passes the scene nearer than this share of the
#: person's size.
NEAREST = 0.3
#: Differences of planes up to this are noise, as a share of the person's size: silhouettes of
#: somebody who keeps still agree at any offset.
NOISE = 0.003
#: Hulls, and the directions (N, 3) in which a camera sees their corners.
Image = tuple[HullRays, np.ndarray]


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
    def cameras(self) -> np.ndarray:
        """Mean (V,) of each camera's pairs."""
        return _divide(self.sums.sum((0, 1)), self.counts.sum((0, 1)))

    def without(self, view: int) -> float:
        """Return the mean of all pairs but one camera's; NaN without any."""
        others = np.delete(np.arange(self.sums.shape[1]), view)
        rest = np.ix_(np.arange(len(self.sums)), others, others)
        return float(_divide(self.sums[rest].sum(), self.counts[rest].sum()))

    def measure_gain(self, after: PairSums, views: Sequence[int]) -> np.ndarray:
        """Return by which share the cost of the pairs of `views` is less after a change, in each
        stretch of frames (B,), see `jackknife`."""
        rows = np.zeros(self.sums.shape[1], bool)
        rows[list(views)] = True
        pairs = np.triu(rows[:, None] | rows[None], 1)
        both = np.stack([self.sums, self.counts, after.sums, after.counts])[..., pairs].sum(-1).T
        return jackknife(
            both[both[:, 1] > 0], lambda of: float(1 - _divide(of[2] * of[1], of[3] * of[0]))
        )


def _divide(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(a / b)


class Tangency:
    """Comparison of outlines [frame][view] of F frames as seen by the cameras of `rig`.

    size: the person's, in the rig's unit: the median distance between the extreme planes, measured
    where the optical axes meet; NaN if no two cameras can be compared.
    """

    def __init__(self, rig: CameraRig, outlines: list[list[Outline | None]]) -> None:
        self.rig, self.outlines = rig, outlines
        self._hulls = [HullRays(c, [row[v] for row in outlines]) for v, c in enumerate(rig)]
        self._images = [self.see(view, view) for view in range(len(rig))]
        scene = intersect_axes_ahead(rig)
        self._baselines = {
            (a, b): look_along_baseline(rig[a], rig[b], scene)[1:]
            for a, b in combinations(range(len(rig)), 2)
        }
        self._planes: dict[tuple[int, int], np.ndarray] = {}
        spans = [
            np.nanmedian(np.diff(planes))
            for pair in self._baselines
            for planes in (self.find_planes(*pair), self.find_planes(*pair[::-1]))
            if np.isfinite(np.diff(planes)).any()
        ]
        self.size = float(np.median(spans)) if spans else float("nan")

    def see(self, view: int, other: int, signs: tuple[int, int] = (1, 1)) -> Image:
        """Return the image of a camera that has the pictures of the `other` camera. signs: of a
        picture's axes (x, y); -1 flips the axis."""
        hulls, last = self._hulls[other], np.array(self.rig[view].size) - 1
        return hulls, self.rig[view].rays(
            np.where(np.less(signs, 0), last, 0) + signs * hulls.pixels
        )

    def turn(self, view: int, rotation: np.ndarray) -> Image:
        """Return the image of a camera whose rays were turned by `rotation` (3, 3)."""
        hulls, rays = self._images[view]
        return hulls, rays @ rotation.T

    def find_planes(self, view: int, other: int, image: Image | None = None) -> np.ndarray:
        """Return the positions (F, 2) of the extreme planes through the line from one camera to
        another that touch the outlines of the first one's image.

        Positions are measured at the scene, in the rig's unit. NaN if there is no outline, or if it
        touches the picture's border there.
        """
        if image is None and (view, other) in self._planes:
            return self._planes[view, other]
        hulls, rays = image or self._images[view]
        axes, distance = self._baselines[min(view, other), max(view, other)]
        flat = rays @ axes
        planes = distance * hulls.extremes(np.arctan2(flat[:, 1], flat[:, 0]), _WIDEST)
        if image is None:
            self._planes[view, other] = planes
        return planes

    @cached_property
    def unchanged(self) -> PairSums:
        """The differences between all pairs of cameras."""
        n = len(self.rig)
        nothing = PairSums(np.zeros((BLOCKS, n, n)), np.zeros((BLOCKS, n, n)))
        return self._compare(nothing, dict.fromkeys(range(n)))

    def compare(self, changes: Mapping[int, Image]) -> PairSums:
        """Return the differences if some cameras had other images."""
        return self._compare(self.unchanged, changes)

    def _compare(self, base: PairSums, changes: Mapping[int, Image | None]) -> PairSums:
        sums, counts = base.sums.copy(), base.counts.copy()
        for a, b in self._baselines:
            if (a in changes or b in changes) and self.comparable(a, b):
                planes = (
                    self.find_planes(a, b, changes.get(a)), self.find_planes(b, a, changes.get(b))
                )  # fmt: skip
                differences = np.subtract(*planes).T[:, None] / max(self.size, 1e-12)
                table = sum_costs(differences, CAP)[0]
                apart, there = np.pad(table, ((0, BLOCKS - len(table)), (0, 0))).T
                sums[:, a, b] = sums[:, b, a] = apart
                counts[:, a, b] = counts[:, b, a] = there
        return PairSums(sums, counts)

    def comparable(self, a: int, b: int) -> bool:
        """Return whether the line between two cameras passes far enough from the scene."""
        return self._baselines[a, b][1] >= NEAREST * self.size

    def measure_times(self, most: int) -> CameraTimes:
        """Estimate the cameras' offsets of up to `most` frames from the motion of their planes."""
        costs = self._compare_motions(2 * most) if most > 1 else {}
        return CameraTimes(len(self.rig), costs, noise=NOISE)

    def measure_offset_costs(self, most: int) -> np.ndarray:
        """Return (V, 2 most + 1) the mean difference of each camera's planes from the others' if
        its pictures came later by -most to most frames."""
        sums = np.zeros((len(self.rig), 2 * most + 1, 2))
        for (a, b), table in self._compare_motions(most).items():
            sums[b] += table.sum(axis=1)
            sums[a] += table.sum(axis=1)[::-1]
        return np.stack([mean_costs(view_sums[:, None]) for view_sums in sums])

    def _compare_motions(self, most: int) -> PairCosts:
        """Return the costs of the pairs of cameras at offsets of up to `most` frames."""
        costs: dict[tuple[int, int], np.ndarray] = {}
        for a, b in self._baselines:
            if self.comparable(a, b):
                pair = self.find_planes(a, b) / self.size, self.find_planes(b, a) / self.size
                table = compare_signals(*pair, most, CAP)
                if table[..., 1].any():
                    costs[a, b] = table
        return costs
