"""Find the cameras that disagree with the others, and the likely reason.

Each camera is compared with the shape that all the others see. The shape is carved without the
camera, projected into it, and compared with those parts of its own silhouette that belong to the
person: a camera is not left out for clutter elsewhere in its picture, or for furniture that stands
before the person.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from psfs.cameras.footprints import voxel_footprints
from psfs.cameras.rig_geometry import find_seen_box, required_cameras
from psfs.common.regions import iou
from psfs.diagnostics.config import ConsistencyConfig
from psfs.sequence import Sequence
from psfs.session import Session
from psfs.silhouettes.hidden import UNKNOWN
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.host_voxels import surface_indices, voxel_silhouette


@dataclass(frozen=True)
class InconsistentCamera:
    """A camera that disagrees with the others: its IoU, the others' IoU, and the likely reason."""

    camera: str
    iou: float
    others: float
    reason: str

    def __str__(self) -> str:
        return (
            f"camera {self.camera} disagrees with the others (IoU {self.iou:.2f} with their "
            f"shape; theirs {self.others:.2f}): {self.reason}"
        )


def find_inconsistent_cameras(
    session: Session,
    known: Mapping[str, str] | None = None,
    limits: ConsistencyConfig | None = None,
) -> list[InconsistentCamera]:
    """Return the cameras that disagree with the others in frames spread over the sequence, worst
    first.

    Needs four cameras; with fewer, the wrong one cannot be identified. Returns at most a third of
    the cameras: if most disagree, the calibration or the background of all is wrong. known: reasons
    that are known already, by the camera's name.
    """
    rig, limits = session.rig, limits or ConsistencyConfig()
    judge = _Judge(session, limits)
    named: list[InconsistentCamera] = []
    left = list(range(len(rig)))
    while len(left) >= 4 and len(named) < len(rig) // 3:
        scores = judge.scores(left)
        if not np.isfinite(scores).any():
            break
        worst = int(np.nanargmin(scores))
        others = float(np.nanmedian(np.delete(scores, worst)))
        if others < limits.agreeing or not scores[worst] < limits.low_share * others:
            break
        view = left.pop(worst)
        reason = (known or {}).get(rig.names[view]) or judge.reason(view, left)
        named.append(InconsistentCamera(rig.names[view], float(scores[worst]), others, reason))
    return named


class _Judge:
    """Evidence of some frames at the voxels of a coarse grid."""

    def __init__(self, session: Session, limits: ConsistencyConfig) -> None:
        self.session, self.rig, self.limits = session, session.rig, limits
        sequence = session.sequence
        last = len(sequence) - 1
        picks = np.linspace(0.1 * last, 0.9 * last, limits.samples).round().astype(int)
        self.frames = [int(i) for i in np.unique(picks)]
        self._evidence = dict(zip(self.frames, session.evidence(self.frames), strict=True))
        self._take(_coarse_grid(sequence, limits))
        self._take(self._fit_grid_to_person())

    def _take(self, grid: VoxelGrid) -> None:
        """Project the voxels of `grid` into all cameras, and use them from now on."""
        self.grid = grid
        centres = grid.centres()
        outside = self.rig.height * self.rig.width
        self._at = np.full((len(self.rig), grid.size), outside, np.int32)
        for at, camera in zip(self._at, self.rig, strict=True):
            inside, row, column, _ = camera.look_up(centres)
            at[inside] = row * self.rig.width + column
        self._shown = self._at < outside
        self._extents = voxel_footprints(self.rig, grid.voxel_size)

    def _fit_grid_to_person(self) -> VoxelGrid:
        """Return a grid around the voxels that are occupied even if one camera denies them."""
        views = list(range(len(self.rig)))
        needed = OccupancyConfig().seeing_cameras(len(views))
        evidence = self.session.reconstruction.silhouette.evidence
        veto = -int(evidence.counts(np.zeros(1))[0])
        occupied = np.zeros(self.grid.size, bool)
        for index in self.frames:
            occupied |= self._counts(index, views).sum(0, np.int32) + veto > 0
        occupied &= self._shown.sum(0) >= needed
        if not occupied.any():
            return self.grid
        centres, margin = self.grid.centres(np.flatnonzero(occupied)), self.grid.voxel_size
        return _make_grid(centres.min(0) - margin, centres.max(0) + margin, self.limits.voxels)

    def scores(self, views: list[int]) -> np.ndarray:
        """Return the mean IoU (len(views),) of each camera's silhouette with the others' shape."""
        scores = []
        seen = self._shown[views].sum(0)
        for index in self.frames:
            counts, evidence = self._counts(index, views), self._evidence[index]
            votes = counts.sum(0, np.int32)
            shapes = [
                self._shape(votes - own, seen - self._shown[view], len(views) - 1)
                for view, own in zip(views, counts, strict=True)
            ]
            scores.append(
                [
                    self._iou(view, shape, evidence)
                    for view, shape in zip(views, shapes, strict=True)
                ]
            )
        empty = np.isnan(scores).all(axis=0)
        return np.where(empty, np.nan, np.nanmean(np.where(empty, 0, scores), axis=0))

    def _counts(self, index: int, views: list[int]) -> np.ndarray:
        """Return the evidence (len(views), voxels) int8 of a frame at the voxels, 0 where it is
        unknown or beside the picture."""
        counts = np.empty((len(views), self.grid.size), np.int8)
        for own, view in zip(counts, views, strict=True):
            evidence = np.append(self._evidence[index][view], np.int8(0))
            evidence[evidence == UNKNOWN] = 0
            own[:] = evidence[self._at[view]]
        return counts

    def _shape(self, votes: np.ndarray, seen: np.ndarray, n_views: int) -> np.ndarray:
        """Return the surface voxels (N,) of a shape. votes: sum of the evidence of `n_views`
        cameras at the voxels; seen: how many of them show each."""
        needed = OccupancyConfig().seeing_cameras(n_views)
        occupied = (votes > 0) & (seen >= needed)
        return surface_indices(occupied.reshape(self.grid.shape))

    def _iou(self, view: int, shape: np.ndarray, evidence: np.ndarray) -> float:
        """Return the IoU of a shape's silhouette with a camera's own; NaN if neither shows."""
        size = (self.rig.height, self.rig.width)
        camera = self.rig.cameras[view]
        expected = voxel_silhouette(camera, self.grid.centres(shape), self._extents[view], size)
        own = select_person(evidence[view] > 0, expected, self.limits.near)
        if (own & expected).sum() >= self.limits.agrees * own.sum():
            expected &= evidence[view] != UNKNOWN  # hidden by furniture, not by an error
        return iou(expected, own)

    def reason(self, view: int, others: list[int]) -> str:
        """Return why camera `view` may disagree with the shape that `others` see."""
        images = self.session.sequence.read(self.frames[0]).images
        width, height = self.rig.cameras[view].size
        if images is not None and images[view, :height, :width].std() < self.limits.least_contrast:
            return f"its picture is one colour, {images[view, :height, :width].mean():.0f} grey"
        maps = [self._evidence[i][view, :height, :width] for i in self.frames]
        shown = float(np.mean([(m > 0).mean() for m in maps]))
        if shown > self.limits.full:
            return (
                f"{shown:.0%} of its picture looks like foreground; noise, or a background that "
                "is not this camera's?"
            )
        if not shown:
            return "it shows no person"
        lag = self._lag(view, others)
        if lag:
            return f"its pictures come about {abs(lag)} frames {'late' if lag > 0 else 'early'}"
        return "its silhouettes are elsewhere; moved camera, or wrong calibration?"

    def _lag(self, view: int, others: list[int]) -> int:
        """Return by how many frames the camera's pictures come late; negative if early, 0 if
        neither."""
        middle = self.frames[len(self.frames) // 2]
        votes = self._counts(middle, others).sum(0, np.int32)
        shape = self._shape(votes, self._shown[others].sum(0), len(others))
        scores = {0: self._iou(view, shape, self._evidence[middle])}
        n_frames = len(self.session.sequence)
        lags = [lag for lag in self.limits.lags if 0 <= middle + lag < n_frames]
        for lag in lags:
            (evidence,) = self.session.evidence([middle + lag])
            scores[lag] = self._iou(view, shape, evidence)
        best = max(scores, key=lambda lag: scores[lag])
        return best if scores[best] > scores[0] + self.limits.rise else 0


def select_person(shown: np.ndarray, expected: np.ndarray, near: float) -> np.ndarray:
    """Return the connected parts of a silhouette (H, W) bool that overlap the expected one, up to
    `near` times its height away from it.

    The others are clutter, or people elsewhere; so is what lies farther away, such as rafters that
    touch the head. If no part overlaps, return the whole silhouette: the person himself appears
    elsewhere.
    """
    count, labels = cv2.connectedComponents(shown.view(np.uint8), connectivity=8)
    meets = np.zeros(count, bool)
    meets[np.unique(labels[expected & shown])] = True
    if not meets.any():
        return shown
    rows, columns = (np.flatnonzero(expected.any(axis)) for axis in (1, 0))
    reach = max(1, round(near * np.ptp(rows)))
    # Only within this distance: in whole pictures it took a fifth of the examination's time.
    reached = tuple(slice(max(0, of[0] - reach), of[-1] + reach + 1) for of in (rows, columns))
    selected = np.zeros_like(shown)
    beside = (~expected[reached]).view(np.uint8)
    away = cv2.distanceTransform(beside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    selected[reached] = meets[labels[reached]] & (away <= reach)
    return selected


def _coarse_grid(sequence: Sequence, limits: ConsistencyConfig) -> VoxelGrid:
    needed = required_cameras(len(sequence.rig), limits.camera_share)
    volume = sequence.volume or find_seen_box(sequence.rig, needed)
    if volume is None:
        volume = find_seen_box(sequence.rig, 2) or (np.full(3, -1.0), np.full(3, 1.0))
    low, high = (np.asarray(corner, np.float64) for corner in volume)
    return _make_grid(low, high, limits.voxels)


def _make_grid(low: np.ndarray, high: np.ndarray, voxels: int) -> VoxelGrid:
    return VoxelGrid.covering(low, high, float(np.cbrt(np.prod(high - low) / voxels)))
