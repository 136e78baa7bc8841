"""The part of a hull that nothing fills, between people who stand, and what shows only one of them.

If cameras face each other, the hull of two people before a poor background reaches from one to the
other. Each one's part of it then covers the other in pictures, and the other's foreground would
count as theirs. Before a good background that part is smaller, but arms between people follow it.
"""

from __future__ import annotations

import cv2
import numpy as np

from psfs.background.standing import StandingPeople
from psfs.cameras.camera import Camera, CameraRig
from psfs.people.agreement import Disagreement
from psfs.people.contact import SplitCloud
from psfs.silhouettes.hidden import UNKNOWN_MASK

#: Factor of the radii of the inside of a person who stands, which then holds the person but for
#: lifted arms and legs: before a background that shows people poorly, and before a good one.
_GIRTH_POOR, _GIRTH_GOOD = 2.0, 1.5
#: Least number of cameras in which a voxel shows beside all people.
_LEAST_FREE = 2
#: Disagreement of the cameras on the colours of voxels below which they are a body's: nine tenths
#: of forearms and a quarter of ghosts in four takes of two people.
_AGREED = 0.34
#: Points of a ring around a person's axis.
_RING = 16


class Ghosts:
    """The pixels that people who stand cover in one frame, by which ghosts are known.

    covered: (P, V, H, W) bool, the pixels that each person may cover but for lifted limbs. poor:
    whether the background shows people poorly.
    """

    def __init__(
        self, rig: CameraRig, standing: StandingPeople, frame: int, poor: bool = True
    ) -> None:
        self._rig, self._standing, self._frame, self._poor = rig, standing, frame, poor
        self._girth = _GIRTH_POOR if poor else _GIRTH_GOOD
        shape = len(rig), rig.height, rig.width
        rings = standing.rings(frame, self._girth, _RING)
        self.covered = np.zeros((len(rings), *shape), bool)
        for covered, person in zip(self.covered, rings, strict=True):
            for camera, picture in zip(rig, covered, strict=True):
                _draw_hulls(camera, person, picture)

    def drop(self, split: SplitCloud) -> SplitCloud:
        """Return what is left of people's voxels, see `find_own`."""
        clouds = self._keep(split.clouds)
        sole = clouds if split.sole is split.clouds else self._keep(split.sole)
        return SplitCloud(clouds, sole, split.near)

    def hide_others(self, masks: np.ndarray) -> None:
        """Make unknown, in the masks (P, V, H, W) of people, the foreground that another one covers
        and the person does not."""
        for number, mask in enumerate(masks):
            others = np.delete(self.covered, number, axis=0).any(0)
            mask[others & ~self.covered[number] & (mask > UNKNOWN_MASK)] = UNKNOWN_MASK

    def find_own(
        self, number: int, points: np.ndarray, colours: Disagreement | None = None
    ) -> np.ndarray:
        """Return (N,) bool: which of the points (N, 3) m may be a person's: those inside the space
        that the person takes up, and beside it those on whose colours the cameras agree. Where
        that is not known, it is those that two cameras show beside all people, and before a good
        background those that others hide in no camera that shows them beside the person."""
        own = self._standing.select([number]).contain(points, self._frame, self._girth)
        outside = points[~own]
        others = np.logical_or.reduce(np.delete(self.covered, number, axis=0))
        beside, hidden = np.zeros((2, len(outside)), int)
        for camera, mine, theirs in zip(self._rig, self.covered[number], others, strict=True):
            inside, row, column, _ = camera.look_up(outside)
            beside[inside] += ~mine[row, column]
            hidden[inside] += (~mine & theirs)[row, column]
        free = beside - hidden >= _LEAST_FREE
        kept = free if self._poor else free | (hidden == 0)
        if colours is not None:
            apart = colours.find(outside)
            kept = np.where(np.isnan(apart), kept, apart < _AGREED)
        own[~own] = kept
        return own

    def _keep(self, clouds: list[np.ndarray]) -> list[np.ndarray]:
        kept = [points[self.find_own(k, points)] for k, points in enumerate(clouds[:-1])]
        return [*kept, *clouds[-1:]]


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
