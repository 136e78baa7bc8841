"""The space that people who stand take up, known from their places alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

#: Heights and radii of the inside of a person who stands, as a body of revolution, in shares of the
#: stature: feet, knees, hips, elbows, shoulders, neck, head. By hand on Pose2Sim's
#: `Demo_MultiPerson`: four thirds of the radii cover more of the people, but starts fit worse.
_HEIGHTS = np.array([0.0, 0.28, 0.49, 0.74, 0.80, 0.85, 0.96, 1.0])
_RADII = np.array([0.045, 0.056, 0.074, 0.082, 0.067, 0.037, 0.041, 0.022])


@dataclass(frozen=True, eq=False)
class StandingPeople:
    """The places of people in a take.

    frames: (F,) int, ascending. places: (F, P, 3) m: x, y and height of the top of each person; NaN
    where a person is not seen.
    """

    frames: np.ndarray
    places: np.ndarray

    def select(self, people: Sequence[int]) -> StandingPeople:
        """Return the places of some of the people."""
        return StandingPeople(self.frames, self.places[:, list(people)])

    def contain(self, points: np.ndarray, number: int, girth: float = 1.0) -> np.ndarray:
        """Return (N,) bool: which of the points (N, 3) m lie in the people's space in a frame, or
        in the nearest one whose places are known. girth: factor of the radii."""
        inside = np.zeros(len(points), bool)
        for x, y, top in self.find(number):
            share = points[:, 2] / top
            radius = girth * top * np.interp(share, _HEIGHTS, _RADII, right=0)
            inside |= np.hypot(points[:, 0] - x, points[:, 1] - y) < radius
        return inside

    def rings(self, number: int, girth: float, n_points: int) -> np.ndarray:
        """Return points (P, R, n_points, 3) m on circles around each person's axis, from the feet
        up, on the surface of that space in a frame; NaN for who is not seen."""
        angles = 2 * np.pi / n_points * np.arange(n_points)
        around = np.stack([np.cos(angles), np.sin(angles)], -1)
        places = self.find(number)
        flat = places[:, None, None, :2] + (
            girth * places[:, 2, None, None, None] * _RADII[:, None, None] * around
        )
        heights = np.broadcast_to((places[:, 2:] * _HEIGHTS)[..., None, None], (*flat.shape[:3], 1))
        return np.concatenate([flat, heights], -1)

    def find(self, number: int) -> np.ndarray:
        """Return the places (P, 3) in a frame, or in the nearest one."""
        nearest = int(np.abs(self.frames - number).argmin())
        return self.places[nearest]
