"""Where people stand, from their coarse voxels, and the space that they take up there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from psfs.voxels.grid import VoxelGrid

#: Standard deviation of the voxels of a person who stands from their axis, m.
_AXIS_STD = 0.15
#: Heights and radii of the inside of a person who stands, as a body of revolution, in shares of the
#: stature: feet, knees, hips, elbows, shoulders, neck, head. By hand: with four thirds of
#: the radii it covers more of the people, but starts fit worse.
_HEIGHTS = np.array([0.0, 0.28, 0.49, 0.74, 0.80, 0.85, 0.96, 1.0])
_RADII = np.array([0.045, 0.056, 0.074, 0.082, 0.067, 0.037, 0.041, 0.022])
#: Points of a ring around a person's axis.
RING = 16


@dataclass(frozen=True, eq=False)
class StandingPeople:
    """The places of people in a take.

    frames: (F,) int, ascending. places: (F, P, 3) m: x, y and height of the top of each person; NaN
    where a person is not seen.
    """

    frames: np.ndarray
    places: np.ndarray

    def contain(
        self, points: np.ndarray, frame: int, person: int, girth: float = 1.0
    ) -> np.ndarray:
        """Return (N,) bool: which of the points (N, 3) m lie in a person's space in a frame, or in
        the nearest one whose places are known. girth: factor of the radii."""
        x, y, top = self.find(frame)[person]
        radius = girth * top * np.interp(points[:, 2] / top, _HEIGHTS, _RADII, right=0)
        return np.asarray(np.hypot(points[:, 0] - x, points[:, 1] - y) < radius)

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


def find_places(
    grid: VoxelGrid,
    frames: Sequence[int],
    persons: Sequence[dict[int, np.ndarray]],
) -> StandingPeople:
    """Return where people stand in `frames`: the axis and the top of each one's coarse voxels of
    `grid`, flat indices by frame."""
    places = np.full((len(frames), len(persons), 3), np.nan)
    for number, voxels in enumerate(persons):
        for row, frame in enumerate(frames):
            if frame in voxels:
                axis, top = _find_axis(grid.centres(voxels[frame]))
                places[row, number] = *axis, top + grid.voxel_size / 2
    return StandingPeople(np.array(frames), places)


def _find_axis(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the vertical axis (2,) that most of the points (N, 3) are near to, and the highest z
    about it, m."""
    flat, heights = np.unique(points[:, :2], axis=0, return_counts=True)
    apart = np.linalg.norm(flat[:, None] - flat, axis=-1)
    around = np.exp(-0.5 * (apart / _AXIS_STD) ** 2) @ heights
    near = apart[around.argmax()] < 2 * _AXIS_STD
    axis = np.average(flat[near], axis=0, weights=heights[near])
    about = np.linalg.norm(points[:, :2] - axis, axis=1) < 2 * _AXIS_STD
    return axis, float(points[about, 2].max())
