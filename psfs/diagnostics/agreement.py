"""Agreement of silhouettes with their common visual hull, with and without each camera.

A hull contains what it was carved from, so the hull of sound cameras covers the silhouettes of
all. A camera that was moved, is late or films something else cuts into the hull of the others, and
lies beside it. Without this camera the others agree.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import find_seen_box, required_cameras
from psfs.common.numbers import known_means, pick_evenly
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.occupied_box import CoarseSpace, look_up

#: Most voxels of the grid around the person, and frames in which it is carved.
_VOXELS, _FRAMES = 150_000, 12
#: Distance from the common hull within which foreground is the person's, as a share of the hull's
#: height: what lies farther away is clutter.
_NEAR = 0.15


def leave_out(outside: np.ndarray, view: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean shares (S,) of the silhouettes of all cameras but one that lie outside their
    common hull, with this camera and without it. outside: see `HullAgreement.measure`."""
    shares = np.diagonal(outside, axis1=1, axis2=2), outside[:, :, view]
    with_it, without = (known_means(np.delete(of, view, axis=1), axis=1) for of in shares)
    return with_it, without


class HullAgreement:
    """Hulls of silhouettes (S, V, h, w) bool in a coarse grid around the person."""

    def __init__(self, rig: CameraRig, silhouettes: np.ndarray) -> None:
        self.rig = rig
        self.samples = pick_evenly(len(silhouettes), _FRAMES)
        self.masks = silhouettes[self.samples].view(np.uint8)
        square = np.ones((3, 3), np.uint8)
        self._wide = np.stack([[cv2.dilate(mask, square) for mask in row] for row in self.masks])
        box = find_seen_box(rig, required_cameras(len(rig), 0.5)) or find_seen_box(rig, 2)
        low, high = box or (np.full(3, -1.0), np.full(3, 1.0))
        self.space = self._make_space(low, high)
        common = np.zeros(len(self.space.used), bool)  # in a frame all cameras but one show them
        for frame in range(len(self.masks)):
            common[self._find_candidates(frame, np.arange(len(rig)))[0]] = True
        occupied = self.space.used[common]
        if len(occupied):
            centres, edge = self.space.grid.centres(occupied), self.space.grid.voxel_size
            self.space = self._make_space(centres.min(0) - edge, centres.max(0) + edge)

    def measure(self, views: Sequence[int]) -> np.ndarray:
        """Return (S, V, V) how the silhouettes of V cameras agree in S frames: the share of the
        silhouette of camera u (second axis) outside the hull of all cameras but w (third axis); NaN
        without a silhouette."""
        chosen = np.asarray(views)
        outside = np.full((len(self.masks), len(chosen), len(chosen)), np.nan)
        for frame in range(len(self.masks)):
            voxels, missing = self._find_candidates(frame, chosen)
            persons = [self._select_person(frame, int(view), voxels) for view in views]
            for without in range(len(chosen)):
                hull = voxels[np.delete(missing, without, axis=0).sum(0) == 0]
                for row, person in enumerate(persons):
                    if person.any():
                        beyond = person & ~self.project(int(chosen[row]), hull)
                        outside[frame, row, without] = beyond.sum() / person.sum()
        return outside

    def expect(self, frame: int, view: int, views: Sequence[int]) -> np.ndarray:
        """Return the pixels (h, w) bool of a camera that the hull of all others of `views` covers,
        in the picture of sample `frame`."""
        others = np.array([other for other in views if other != view])
        voxels, missing = self._find_candidates(frame, others)
        return self.project(view, voxels[missing.sum(0) == 0])

    def project(self, view: int, voxels: np.ndarray) -> np.ndarray:
        """Return the pixels (h, w) bool of a camera that the voxels (N,) cover, and their rim."""
        return self.space.cover(view, voxels, margin=2)

    def _make_space(self, low: np.ndarray, high: np.ndarray) -> CoarseSpace:
        grid = VoxelGrid.covering(low, high, float(np.cbrt(np.prod(high - low) / _VOXELS)))
        space = CoarseSpace(self.rig, grid, min_cameras=1)
        if self.rig.hidden is not None:
            space.pixels[look_up(self.rig.hidden, space.pixels)] = -1
        return space

    def _find_candidates(self, frame: int, views: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the voxels (N,) that enough cameras see and of these all but one show, and which
        cameras (len(views), N) see them and show none."""
        pixels = self.space.pixels[views]
        foreground = look_up(self._wide[frame, views], pixels) > 0
        missing = (pixels >= 0) & ~foreground
        needed = max(1, min(2, len(views) - 1))
        voxels = np.flatnonzero((missing.sum(0) <= 1) & (foreground.sum(0) >= needed))
        return voxels, missing[:, voxels]

    def _select_person(self, frame: int, view: int, common: np.ndarray) -> np.ndarray:
        """Return the parts (h, w) bool of a silhouette that meet the common hull, near it; the
        whole silhouette if none does."""
        silhouette, expected = self.masks[frame, view], self.project(view, common)
        _, labels = cv2.connectedComponents(silhouette, connectivity=8)
        met = np.unique(labels[expected & (silhouette > 0)])
        if not len(met):
            return silhouette > 0
        reach = max(1, round(_NEAR * np.ptp(np.flatnonzero(expected.any(axis=1)))))
        vicinity = cv2.dilate(expected.view(np.uint8), np.ones((2 * reach + 1,) * 2, np.uint8)) > 0
        return np.isin(labels, met) & vicinity
