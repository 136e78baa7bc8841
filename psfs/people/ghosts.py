"""Phantom volume between people who stand: the part of their hull that nothing fills.

Arms between people would follow it.
"""

from __future__ import annotations

import cv2
import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.people.agreement import Disagreement
from psfs.people.standing import RING, StandingPeople

#: Factor of the radii of the inside of a person who stands, which then holds the person but for
#: lifted arms and legs.
_GIRTH = 1.5
#: Least number of cameras in which a voxel shows beside all people.
_LEAST_FREE = 2
#: Disagreement of the cameras on the colours of voxels below which they are a body's: tuned,
#: nine tenths of forearms and a quarter of ghosts are.
_AGREED = 0.34


class Ghosts:
    """The pixels that people who stand cover in one frame, by which ghosts are known.

    covered: (P, V, H, W) bool, the pixels that each person may cover but for lifted limbs.
    """

    def __init__(self, rig: CameraRig, standing: StandingPeople, frame: int) -> None:
        self._rig, self._standing, self._frame = rig, standing, frame
        shape = len(rig), rig.height, rig.width
        rings = standing.rings(frame, _GIRTH, RING)
        self.covered = np.zeros((len(rings), *shape), bool)
        for covered, person in zip(self.covered, rings, strict=True):
            for camera, picture in zip(rig, covered, strict=True):
                _draw_hulls(camera, person, picture)

    def find_own(
        self, number: int, points: np.ndarray, colours: Disagreement | None = None
    ) -> np.ndarray:
        """Return (N,) bool: which of the points (N, 3) m may be a person's: those inside the space
        that the person takes up, and beside it those on whose colours the cameras agree. Where
        that is not known, it is those that two cameras show beside all people, and those that
        others hide in no camera that shows them beside the person."""
        own = self._standing.contain(points, self._frame, number, _GIRTH)
        outside = points[~own]
        others = np.logical_or.reduce(np.delete(self.covered, number, axis=0))
        beside, hidden = np.zeros((2, len(outside)), int)
        for camera, mine, theirs in zip(self._rig, self.covered[number], others, strict=True):
            inside, row, column, _ = camera.look_up(outside)
            beside[inside] += ~mine[row, column]
            hidden[inside] += (~mine & theirs)[row, column]
        free = beside - hidden >= _LEAST_FREE
        kept = free | (hidden == 0)
        if colours is not None:
            apart = colours.find(outside)
            kept = np.where(np.isnan(apart), kept, apart < _AGREED)
        own[~own] = kept
        return own


def _draw_hulls(camera: Camera, rings: np.ndarray, picture: np.ndarray) -> None:
    """Mark in the picture (H, W) bool the hulls of each two rings (R, n, 3) m that follow each
    other; rings that the camera does not show are left out."""
    pixels, depths = camera.project(rings)
    seen = np.logical_and.reduce(depths > 0, axis=1)
    drawn = np.zeros(picture.shape, np.uint8)
    for low in np.flatnonzero(seen[:-1] & seen[1:]):
        both = np.rint(pixels[low : low + 2].reshape(-1, 2)).astype(np.int32)
        cv2.fillConvexPoly(drawn, cv2.convexHull(both), 1)
    picture |= drawn > 0
