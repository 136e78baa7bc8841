"""Where people stand is found from their coarse voxels, and what space they take up there."""

from __future__ import annotations

import numpy as np

from psfs.people.standing import StandingPeople, find_places
from psfs.voxels.grid import VoxelGrid

GRID = VoxelGrid.covering(np.array([-2.0, -2, 0]), np.array([2.0, 2, 2.2]), 0.08)


def voxels(*boxes: tuple) -> np.ndarray:
    """Flat indices of the voxels in boxes (x, x, y, y, z, z) m."""
    x, y, z = GRID.centres().T
    inside = [
        (x > a) & (x < b) & (y > c) & (y < d) & (z > e) & (z < f) for a, b, c, d, e, f in boxes
    ]
    return np.flatnonzero(np.any(inside, axis=0))


def test_the_axis_runs_through_the_trunk_whatever_an_arm_reaches_for() -> None:
    trunk, arm = (0.3, 0.7, -0.9, -0.5, 0, 1.6), (0.7, 1.5, -0.8, -0.6, 1.2, 2.1)
    other = (-1.2, -0.8, 0.3, 0.7, 0, 1.8)
    persons = [{0: voxels(trunk), 4: voxels(trunk, arm)}, {4: voxels(other)}]
    found = find_places(GRID, range(0, 8, 4), persons)
    np.testing.assert_array_equal(found.frames, [0, 4])
    np.testing.assert_allclose(found.places[:, 0, :2], [[0.5, -0.7]] * 2, atol=0.06)
    np.testing.assert_allclose(found.places[1, 1], [-1, 0.5, 1.8], atol=0.06)
    assert abs(found.places[0, 0, 2] - 1.6) < 0.06 and np.isnan(found.places[0, 1]).all()


def test_people_take_up_space_about_their_axes() -> None:
    places = np.array([[[0, 0, 1.7], [1, 0, 1.5]], [[0.5, 0, 1.7], [np.nan] * 3]])
    people = StandingPeople(np.array([10, 20]), places)
    points = np.array([[0, 0, 1.0], [0.1, 0.05, 1.2], [0.4, 0, 1.2], [0, 0, 1.8], [1, 0, 1.4]])
    both = [people.contain(points, 14, person).tolist() for person in range(2)]
    assert both == [[1, 1, 0, 0, 0], [0, 0, 0, 0, 1]]
    moved = points + np.array([0.5, 0, 0])
    assert people.contain(moved, 90, 0).tolist() == [1, 1, 0, 0, 0]
    assert not people.contain(moved, 90, 1).any()  # who is not seen there
