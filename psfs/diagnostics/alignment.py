"""Correction of a slightly wrong calibration by the silhouettes: `correct_rig`.

Tripods sink, lenses are refocused, and calibration boards are seen from one side only. The cameras
then look some tenths of a degree away from where the calibration says, and arms are carved off the
voxels. Frontier points (see `refinement`) measure the error and correct each camera's direction,
place and focal length, and tell the sub-frame times of the cameras. The correction is fitted to one
half of the frames and judged by the other half.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.special import ndtri

from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.rig_geometry import intersect_axes_ahead
from psfs.diagnostics.frontier import (
    BEND,
    FrontierPoints,
    SilhouetteContours,
    epipolar_residuals,
    find_frontier_points,
)
from psfs.diagnostics.hulls import HullRays, find_person
from psfs.diagnostics.limbs import LimbPoints, measure_limbs
from psfs.diagnostics.refinement import (
    N_PARAMETERS,
    RigCorrections,
    correct_cameras,
    fit_rig,
)
from psfs.diagnostics.small_views import (
    LARGE_SIDE,
    Outline,
    SmallViews,
    mark_hidden_points,
    small_views,
)
from psfs.session import Session

log = logging.getLogger(__name__)

#: Residual in small pictures below which a rig counts as sound, px: exact rigs have up to 0.36.
_SOUND = 0.45
#: Share to which the residuals of held-out frames must shrink: of 74 takes, corrections that mend
#: leave .13 to .61, wrong ones .77 and more, and exact rigs more than .64, moved by .4 px if less
#: than .69.
_SHARE = 2 / 3
#: Length of the stretches that are alternately fitted and held out, frames.
_BLOCK = 10
#: Distances up to which points are matched, one per matching, px.
_GATES = (16.0, 16.0, 8.0, 4.0)
#: Errors of calibrated cameras, see `fit_rig`: turned by up to 0.7 degrees, or exact.
_SPREAD = np.array([*3 * [0.008], *3 * [0.01], 0.005, 0.5])
#: Most last matchings of all frames, which end when the times change by less, frames.
_LAST, _SETTLED = 5, 0.005


@dataclass(frozen=True, eq=False)
class Alignment:
    """A corrected rig.

    corrections: fitted to all frames. before, after: median distance of frontier points from their
    epipolar lines, px, in the frames that were held out from a fit to the others, of pictures with
    the longest side `side`, px. moved: (V,) px by which points around the scene's middle moved in
    each camera's picture.
    """

    rig: CameraRig
    corrections: RigCorrections
    before: float
    after: float
    moved: np.ndarray
    side: int

    def __str__(self) -> str:
        return (
            f"the calibration is off by {np.sqrt(np.mean(self.moved**2)):.1f} px; with corrected "
            f"cameras the silhouettes of held-out frames differ by {self.after:.2f} px instead of "
            f"{self.before:.2f}, in pictures of {self.side} px"
        )

    def is_accepted(self) -> bool:
        """Return whether at most a `_SHARE` of the held-out residuals is left."""
        return self.after <= _SHARE * self.before


def correct_rig(session: Session, views: SmallViews) -> CameraRig:
    """Return the corrected rig of a session; its own if it fits as it is or cannot be judged.

    views: small pictures of these cameras or more. Unless they show that the rig is sound, the
    correction is estimated from larger ones, and the cameras know by how much they are still off
    (see `Camera`).
    """
    rig = session.rig
    if len(rig) < 3 or RigFit.of_views(rig, views).measure() <= _SOUND:
        return rig
    alignment = align_rig(session, rig)
    if alignment is None:
        return rig
    residual = alignment.before
    if alignment.is_accepted():
        log.info("%s: %s", session.sequence.name, alignment)
        rig, residual = alignment.rig, alignment.after
    scale = max(rig.width, rig.height) / alignment.side
    deviation = scale * residual / ndtri(0.75)  # of normal errors with this median
    return CameraRig(tuple(replace(camera, blur=deviation) for camera in rig))


def align_rig(session: Session, rig: CameraRig) -> Alignment | None:
    """Return the alignment of a session's rig by larger pictures; None if it cannot be judged."""
    views = small_views(session.sequence, session.device, LARGE_SIDE)
    return RigFit.of_views(rig, views).align(rig)


class RigFit:
    """The fit of a `small` rig to the outlines [frame][view] of F frames in its pictures."""

    def __init__(self, small: CameraRig, outlines: list[list[Outline | None]]) -> None:
        self.small, self.outlines = small, outlines
        self._contours = [
            SilhouetteContours([row[view] for row in outlines]) for view in range(len(small))
        ]
        self._scene = intersect_axes_ahead(small)
        self._fitted = (np.arange(len(outlines)) // _BLOCK) % 2 == 0

    @classmethod
    def of_views(cls, rig: CameraRig, views: SmallViews) -> RigFit:
        """Return that of a rig whose cameras `views` show, where furniture does not hide them."""
        columns = [views.rig.names.index(name) for name in rig.names]
        small = CameraRig(tuple(views.rig[column] for column in columns))
        outlines = [[row[column] for column in columns] for row in views.outlines]
        return cls(small, mark_hidden_points(outlines, rig, small))

    def measure(self, values: np.ndarray | None = None) -> float:
        """Return the median residual, px, of steady tips in the held-out frames, after corrections
        by values (V, N_PARAMETERS); infinite if there are none."""
        if values is None:
            values = np.zeros((len(self.small), N_PARAMETERS))
        cameras = correct_cameras(self.small, values)
        points = self._find(cameras, _GATES[-1], values[:, 7], ~self._fitted, 0.5 * BEND)
        residuals, _ = epipolar_residuals(cameras, points, values[:, 7])
        return float(np.median(np.abs(residuals))) if len(points) else float("inf")

    def align(self, rig: CameraRig) -> Alignment | None:
        """Return the rig, of which this is the small one, under which the outlines fit best; None
        if they cannot be compared, as those of two cameras."""
        small, outlines = self.small, self.outlines
        if len(small) < 3:
            return None
        before = self.measure()
        last = fit_rig(small, _GATES, partial(self._find, frames=self._fitted), _SPREAD)
        if last is None or np.isinf(before):
            return None
        after = self.measure(last.values)
        hulls = [HullRays(camera, [row[v] for row in outlines]) for v, camera in enumerate(small)]
        axes, sights = measure_limbs(hulls, self._contours)
        for _ in range(_LAST):
            cameras = last.apply(small).cameras
            limbs = LimbPoints(cameras, -last.offsets, axes, *find_person(cameras, sights))
            further = [limbs.bind(np.zeros(len(small)))]
            corrections = fit_rig(small, _GATES[-1:], self._find, _SPREAD, last.values, further)
            if corrections is None or np.isinf(after):
                return None
            last, before_last = corrections, last
            if np.abs(last.offsets - before_last.offsets).max() < _SETTLED:
                break
        corrected = last.apply(rig)
        side = max(small.width, small.height)
        return Alignment(corrected, last, before, after, _measure_motion(rig, corrected), side)

    def _find(
        self, cameras: Sequence[Camera], gate: float, late: np.ndarray,
        frames: np.ndarray | None = None, bend: float = BEND,
    ) -> FrontierPoints:  # fmt: skip
        points = find_frontier_points(cameras, self._contours, self._scene, gate, late, bend)
        return points if frames is None else points.select(frames[points.frames])


def _measure_motion(before: CameraRig, after: CameraRig) -> np.ndarray:
    """Return (V,) how far points around the scene's middle move in each picture, px."""
    around = np.stack(np.meshgrid(*3 * [[-0.7, 0, 0.7]]), -1).reshape(-1, 3)
    points = intersect_axes_ahead(before) + around
    pairs = zip(before, after, strict=True)
    moves = [np.linalg.norm(a.project(points)[0] - b.project(points)[0], axis=1) for a, b in pairs]
    return np.array([np.median(own) for own in moves])
