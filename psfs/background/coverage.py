"""Which pixels people cover in each frame of a take, by all cameras' evidence together."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor

import cv2
import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.rig_geometry import find_seen_box, required_views

#: Number of voxels, at most, in which the rays of the cameras meet.
_VOXELS = 60_000
#: Probability that a camera denies a voxel that is occupied, since a person is in its background,
#: or looks like it: one camera of four may.
_WRONGLY_DENIED = 0.1
#: Span of a tall person's arms, m.
_ARM_SPAN = 1.8
#: Distance by which voxels reach beyond their projected edges, px: of a small picture's blur.
_MARGIN = 1


class Rays:
    """The pixels of all cameras in which the voxels appear where people may be: those that enough
    cameras see move, since furniture may hide them from the others, and those below them down to
    the `floor`, m, if it is given: people stand on one spot.

    regions: (V, h, w) bool, the moving pixels of these voxels, and all those below them."""

    def __init__(self, rig: CameraRig, regions: np.ndarray, floor: float = np.inf) -> None:
        self._shape = regions.shape
        needed = required_views(rig)
        box = find_seen_box(rig, needed) or (np.full(3, -1.0), np.full(3, 1.0))
        floor = max(floor, float(box[0][2]))
        for _ in range(2):  # the second grid bounds the hull of the first
            edge = float(np.cbrt(np.prod(box[1] - box[0]) / _VOXELS))
            axes = [np.arange(a, b, edge) + edge / 2 for a, b in zip(*box, strict=True)]
            centres = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
            shown = np.zeros(len(centres), np.int16)
            for camera, region in zip(rig, regions, strict=True):
                inside, row, column, _ = camera.look_up(centres)
                shown[inside] += region[row, column]
            hull = centres[shown >= needed]
            if not len(hull):
                break
            box = hull.min(0) - edge, hull.max(0) + edge
        below = _find_below(hull, edge, floor)
        n_seeing = sum(camera.look_up(below)[0].astype(int) for camera in rig)
        voxels = np.concatenate([hull, below[n_seeing >= needed]])
        self.n_voxels = len(voxels)
        self._views = [_ViewRays(camera, voxels, edge, rig.width) for camera in rig]
        self.regions = regions & self._where_seen(0) | self._where_seen(len(hull))

    def __len__(self) -> int:
        return len(self._views)

    def gather(self, view: int, maps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the voxels (K,) that a view sees and the values (n, K) of its maps (n, h, w)
        there."""
        of = self._views[view]
        return of.voxels, maps.reshape(len(maps), -1)[:, of.pixels]

    def _where_seen(self, first: int) -> np.ndarray:
        """Return (V, h, w) bool: the pixels in which the voxels from number `first` on appear."""
        chosen = [np.where(of.voxels >= first, 0, -np.inf)[None] for of in self._views]
        return np.stack([self.project(view, of)[0] == 0 for view, of in enumerate(chosen)])

    def project(self, view: int, values: np.ndarray) -> np.ndarray:
        """Return (n, h, w) float32: the greatest of the values (n, K) of the voxels on each pixel's
        ray, in the order of `gather`; -inf where there is no voxel."""
        of, (_, height, width) = self._views[view], self._shape
        maps = np.full((len(values), height * width), -np.inf, np.float32)
        if len(of.voxels):
            maps[:, of.pixels[of.starts]] = np.maximum.reduceat(values, of.starts, axis=1)
        kernel = np.ones((of.across, of.across), np.uint8)
        return np.stack([cv2.dilate(own.reshape(height, width), kernel) for own in maps])


def _find_below(hull: np.ndarray, edge: float, floor: float) -> np.ndarray:
    """Return the centres (K, 3) of the voxels below the lowest of each column of the hull (N, 3),
    down to the height `floor`, where the hull is no wider than an arm span: who walks about is not
    in the median."""
    if not len(hull):
        return hull
    ascending = hull[np.argsort(hull[:, 2], kind="stable")]
    cells = np.round((ascending[:, :2] - hull[:, :2].min(0)) / edge).astype(int)
    columns, lowest = np.unique(cells, axis=0, return_index=True)
    plan = np.zeros(columns.max(0) + 1, np.uint8)
    plan[tuple(columns.T)] = 1
    _, parts, sizes, _ = cv2.connectedComponentsWithStats(plan)
    widths = edge * sizes[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(1)
    feet = ascending[lowest][widths[parts[tuple(columns.T)]] < _ARM_SPAN]
    n_steps = int(max(feet[:, 2].max(initial=-np.inf) - floor, 0) / edge)
    down = np.arange(1, n_steps + 1)[:, None, None] * np.array([0, 0, edge])
    below = (feet - down).reshape(-1, 3)
    return below[below[:, 2] > floor]


class _ViewRays:
    """A view's voxels in the order of the pixels in which they appear; starts: the first one of
    each pixel. across: their size, px."""

    def __init__(self, camera: Camera, voxels: np.ndarray, edge: float, width: int) -> None:
        inside, row, column, depth = camera.look_up(voxels)
        pixels = row * width + column
        order = np.argsort(pixels, kind="stable")
        self.voxels, self.pixels = np.flatnonzero(inside)[order], pixels[order]
        self.starts = np.flatnonzero(np.diff(self.pixels, prepend=-1))
        nearest = float(np.percentile(depth, 10)) if len(depth) else np.inf
        self.across = max(1, int(np.ceil(edge * camera.K[0, 0] / nearest))) + 2 * _MARGIN


class Coverage:
    """Estimates who covers which pixel. agreement: correlation of the pixels that look like a
    person with those that the other cameras take for one, the mean over the cameras: a mask that
    is larger agrees no better by chance."""

    def __init__(self, rays: Rays) -> None:
        self._rays, self.agreement = rays, 0.0

    def update(self, evidence: Sequence[np.ndarray], pool: Executor) -> np.ndarray:
        """Return (V, n, h, w) bool: whether a pixel more likely shows a person than the background,
        given its own `evidence` (n, h, w) of each view, log ratios, and that of the other views.

        A view's evidence for a voxel is log(P / 0.5) of the pixel's probability P of a person: what
        is in front of it or behind it may be seen instead (Song et al. eq. (5)).
        """
        rays, total = self._rays, np.zeros((len(evidence[0]), self._rays.n_voxels), np.float32)

        def weigh(view: int) -> tuple[np.ndarray, np.ndarray]:
            voxels, ratios = rays.gather(view, evidence[view])
            person = 1 / (1 + np.exp(-ratios))
            return voxels, np.log(2 * np.maximum(person, _WRONGLY_DENIED)).astype(np.float32)

        views = list(pool.map(weigh, range(len(rays))))
        for voxels, nats in views:
            total[:, voxels] += nats

        def ask_others(view: int) -> tuple[np.ndarray, float]:
            voxels, nats = views[view]
            others = rays.project(view, total[:, voxels] - nats)
            return evidence[view] + others > 0, _correlate(evidence[view] > 0, others > 0)

        covered, agreements = zip(*pool.map(ask_others, range(len(rays))), strict=True)
        self.agreement = float(np.mean(agreements))
        return np.stack(covered)


def _correlate(first: np.ndarray, second: np.ndarray) -> float:
    """Return the correlation coefficient of two masks, 0 if either is the same everywhere."""
    both, a, b = (float(np.mean(mask)) for mask in (first & second, first, second))
    spread = a * (1 - a) * b * (1 - b)
    return (both - a * b) / spread**0.5 if spread else 0.0
