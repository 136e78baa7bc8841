"""Where people stand is found from their coarse voxels."""

from dataclasses import replace

import numpy as np
from helpers.shared import shared_data

from cl import Device
from psfs.diagnostics.examination import examine
from psfs.people.people import People, Person, count_people
from psfs.sequence import Sequence
from psfs.session import Session, SessionSettings
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
    voxels_of = [{0: voxels(trunk), 4: voxels(trunk, arm)}, {4: voxels(other)}]
    persons = tuple(Person(np.array(sorted(of)), of) for of in voxels_of)
    found = People(range(0, 8, 4), GRID, persons).find_positions()
    np.testing.assert_array_equal(found.frames, [0, 4])
    np.testing.assert_allclose(found.positions[:, 0, :2], [[0.5, -0.7]] * 2, atol=0.12)
    np.testing.assert_allclose(found.positions[1, 1], [-1, 0.5, 1.8], atol=0.06)
    assert abs(found.positions[0, 0, 2] - 1.6) < 0.06 and np.isnan(found.positions[0, 1]).all()


def test_four_men_are_four(device: Device) -> None:
    """Three who touch, and a ghost that explains a man; the men of other moments stand elsewhere,
    and nothing hides them."""
    sequence = Sequence.open(shared_data("utrecht_four_men_4cam"))
    session = Session(sequence, device, SessionSettings(selection=slice(7, 8)))
    assert count_people(examine(session).session).counts.tolist() == [4]


def test_moments_that_do_not_follow_one_another_are_said(device: Device) -> None:
    """Eight moments of four men: nobody can be followed, and one person would be false."""
    session = Session(Sequence.open(shared_data("utrecht_four_men_4cam")), device)
    found = count_people(session)
    assert found.misses_somebody
    assert found.describe().startswith("4 people are seen at once in most frames")


def test_more_people_than_can_be_followed_are_said() -> None:
    box = (-0.2, 0.2, -0.2, 0.2, 0, 1.7)
    alone = People(range(2), GRID, (Person(np.arange(2), dict.fromkeys(range(2), voxels(box))),))
    assert alone.describe() == "one person is seen"
    several = replace(alone, at_once=3)
    assert several.misses_somebody and several.describe().startswith("3 people are seen at once")
    assert not replace(several, objects=2).misses_somebody
