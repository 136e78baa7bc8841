"""Keypoints of several people, by a network that finds one person in a picture, from where each
stands."""

from __future__ import annotations

import numpy as np

from apf.keypoints.network import PoseNetwork
from apf.keypoints.readers.orders import MEDIAPIPE
from psfs.cameras.camera import Camera
from psfs.people.people import StandingPeople

_TRUNK = [MEDIAPIPE.index(n) for n in ("left_shoulder", "right_shoulder", "left_hip", "right_hip")]
#: Radius and height of the region about a person's axis, and height of the trunk, as shares
#: of the person's height.
_RADIUS, _ABOVE, _TRUNK_HEIGHT = 0.5, 1.25, 0.67
#: Distance from the trunk beyond which keypoints are somebody else's, as a share of the height.
_REACH = 0.25


class PersonFinder:
    """Detection of one of several people in one camera's video.

    The network sees the part of the picture in which the person is during the take, and follows
    the person. If it finds somebody else, it searches again in the region about the person's axis
    alone.
    """

    def __init__(
        self,
        network: PoseNetwork,
        camera: Camera,
        people: StandingPeople,
        person: int,
    ) -> None:
        self._network, self._camera, self._people = network, camera, people
        self._person = person
        self._follows = False
        regions = [self._find_region(position) for position in people.positions[:, person]]
        boxes = np.array([region for region in regions if region is not None]).reshape(-1, 4)
        self._crop = np.concatenate(
            [boxes[:, :2].min(0, initial=2**30), boxes[:, 2:].max(0, initial=0)]
        )

    def __call__(self, picture: np.ndarray, number: int) -> np.ndarray | None:
        """Return the keypoints (33, 3) px of the person in the picture (h, w, 3) of a frame, None
        if they are not found."""
        positions = self._people.find(number)
        region = self._find_region(positions[self._person])
        points = None
        if region is not None and self._follows:
            points = self._detect(picture, positions)
        if region is not None and points is None:
            self._network.forget()
            left, top, right, bottom = region
            alone = np.full_like(picture, round(picture.mean()))
            alone[top:bottom, left:right] = picture[top:bottom, left:right]
            points = self._detect(alone, positions)
        self._follows = points is not None
        return points

    def _detect(self, picture: np.ndarray, positions: np.ndarray) -> np.ndarray | None:
        """Return the keypoints in a picture, None if they are those of nobody, or of somebody else:
        far from the person's of `positions` (P, 3), or nearer to another's."""
        left, top, right, bottom = self._crop
        points = self._network(picture[top:bottom, left:right])
        if points is None:
            return None
        points = points + np.array([left, top, 0])
        trunks = positions * [1, 1, _TRUNK_HEIGHT]
        pixels, _ = self._camera.project(trunks)
        above, _ = self._camera.project(trunks + positions * [0, 0, 0.25])
        height = 4 * np.linalg.norm(above - pixels, axis=1)[self._person]
        away = np.linalg.norm(pixels - points[_TRUNK, :2].mean(0), axis=1)
        distances = away[self._person]
        return points if distances < _REACH * height and distances <= np.nanmin(away) else None

    def _find_region(self, position: np.ndarray) -> np.ndarray | None:
        """Return the region (4,) int, left, top, right, bottom px, about a position (3,): x, y and
        height of the top, m. None if that is unknown or not in the picture."""
        if not np.isfinite(position).all():
            return None
        angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        ring = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
        heights = np.array([0, 0.5, 1]) * _ABOVE * position[2]
        points = np.array([*position[:2], 0]) + _RADIUS * position[2] * ring
        pixels, depths = self._camera.project(points + heights[:, None, None] * [0, 0, 1])
        if not (depths > 0).all():
            return None
        pixels = np.clip(pixels.reshape(-1, 2), 0, self._camera.size)
        low, high = np.floor(pixels.min(0)), np.ceil(pixels.max(0))
        return np.concatenate([low, high]).astype(int) if (high > low + 1).all() else None
