"""People keep their identity from frame to frame, in coarse voxels."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from psfs.people.coarse_voxels import CoarseFrame
from psfs.people.following import Trajectory, count_heads, follow
from psfs.people.people import (
    count_voxels,
    find_present_frames,
    is_person,
    is_tall,
    join_returning,
)
from psfs.voxels.division import BANDS, LEVELS
from psfs.voxels.grid import VoxelGrid

FPS, SIZE = 10.0, 0.08
GRID = VoxelGrid.covering(np.array([-2.0, -2.0, 0.0]), np.array([2.0, 2.0, 2.0]), SIZE)
PLACES = GRID.centres()


def column(x: float, y: float, low: float = 0.0, high: float = 1.7) -> np.ndarray:
    """Voxels (nx ny nz,) bool of somebody who stands at x, y."""
    beside = np.abs(PLACES[:, :2] - [x, y]).max(1) < 0.22
    return beside & (PLACES[:, 2] > low) & (PLACES[:, 2] < high)


def frame(index: int, *columns: np.ndarray) -> CoarseFrame:
    occupied = np.any([np.zeros(GRID.size, bool), *columns], axis=0)
    labels, _ = ndimage.label(occupied.reshape(GRID.shape), np.ones((3, 3, 3)))
    voxels = np.flatnonzero(occupied)
    return CoarseFrame(index, voxels, labels.ravel()[voxels] - 1)


def where(one: Trajectory, index: int) -> np.ndarray:
    return np.median(GRID.centres(one.voxels[index])[:, :2], axis=0)


@pytest.mark.parametrize("ahead", [True, False])
def test_people_who_pass_each_other_and_touch_keep_their_names(ahead: bool) -> None:
    times = range(21) if ahead else range(20, -1, -1)
    frames = [
        frame(n, column(0.15 * t - 1.5, -0.2), column(1.5 - 0.15 * t, 0.2))
        for n, t in enumerate(times)
    ]
    found = follow(frames, GRID, FPS)
    assert len(found) == 2
    for one in found:
        assert len(one.voxels) == 21
        assert abs(where(one, 0)[0] + where(one, 20)[0]) < 0.2  # on the other side
        assert abs(where(one, 0)[1] - where(one, 20)[1]) < 0.1  # in the own lane


@pytest.mark.parametrize("leaves", [True, False])
def test_who_comes_or_leaves_beside_somebody_is_there_until_then(leaves: bool) -> None:
    times = list(range(-4, 12) if leaves else range(11, -5, -1))
    frames = [
        frame(n, column(0, 0), *[column(0.35, 0.1 * max(0, 8 - t))] * (t < 10))
        for n, t in enumerate(times)
    ]
    found = follow(frames, GRID, FPS)
    assert sorted(len(one.voxels) for one in found) == [14, 16]


def test_who_touches_at_first_is_known_from_later() -> None:
    frames = [frame(n, column(-0.2 - 0.08 * n, 0), column(0.2 + 0.08 * n, 0)) for n in range(15)]
    found = follow(frames, GRID, FPS)
    assert [len(one.voxels) for one in found] == [15, 15]
    assert sorted(float(np.sign(where(one, 0)[0])) for one in found) == [-1, 1]


def test_a_stated_number_of_people_who_touch_all_the_time() -> None:
    frames = [
        frame(n, column(0.1 * n - 0.2, 0), column(0.1 * n + 0.2, 0.1 * (n % 3)), column(-1.5, 1))
        for n in range(8)
    ]
    assert len(follow(frames, GRID, FPS)) == 2
    found = follow(frames, GRID, FPS, 3)
    assert [len(one.voxels) for one in found] == [8] * 3
    places = sorted(where(one, 7)[0] for one in found)
    np.testing.assert_allclose(places, [-1.5, 0.5, 0.9], atol=2 * SIZE)


def walker(x: float, top: float) -> np.ndarray:
    """Somebody whose head is narrower than the shoulders, so that only heads are apart."""
    head = np.abs(PLACES[:, :2] - [x, 0]).max(1) < 0.13
    return column(x, 0, high=0.8 * top) | (head & (PLACES[:, 2] < top))


@pytest.mark.parametrize(("shown", "people"), [(5, 2), (3, 1)])
def test_heads_tell_how_many_touch_all_the_time(shown: int, people: int) -> None:
    frames = [
        frame(n, walker(0.08 * n - 0.56, 1.8), walker(0.08 * n - 0.08, 1.65 if n < shown else 1.2))
        for n in range(8)
    ]
    heads = count_heads(frames, GRID)
    assert heads == (people if people > 1 else None)
    found = follow(frames, GRID, FPS, heads)
    assert [len(one.voxels) for one in found] == [8] * people


def test_a_body_torn_in_two_is_one_person() -> None:
    frames = [
        frame(n, column(0, 0, 0, 0.7), column(0, 0, 0.8 + 0.2 * (n % 2), 1.7)) for n in range(8)
    ]
    found = follow(frames, GRID, FPS)
    assert len(found) == 1
    assert len(found[0].voxels) == 8


LYING = np.any([column(1.2, y, high=0.5) for y in (-0.4, 0, 0.4)], axis=0)


@pytest.mark.parametrize(
    ("other", "person"),
    [
        (lambda n: column(1.2, 1.2, high=0.5), False),  # low
        (lambda n: column(1.2, 0) if n < 3 else LYING, True),  # lies down
        (lambda n: column(0.6, 0, high=1.0), False),  # a trolley beside somebody all the time
    ],
)
def test_what_moves_is_a_person_or_not(other: Callable[[int], np.ndarray], person: bool) -> None:
    found = follow([frame(n, column(0, 0), other(n)) for n in range(9)], GRID, FPS)
    largest = max(count_voxels(one) for one in found)
    assert [is_person(one, GRID, largest) for one in found] == [True, person]
    assert [is_tall(one, GRID) for one in found] == [True, person]


def test_a_child_beside_a_tall_man_is_a_person() -> None:
    (one,) = follow([frame(n, column(0, 0, high=1.25)) for n in range(5)], GRID, FPS)
    largest = count_voxels(one)
    assert [is_person(one, GRID, times * largest) for times in (4, 6)] == [
        True,
        False,
    ]


def test_nobody_begins_in_a_ghost() -> None:
    first = frame(0, column(0, 0), column(1.2, 0))
    ghost = int(first.regions[np.isin(first.voxels, np.flatnonzero(column(1.2, 0)))][0])
    frames = [replace(first, ghosts=frozenset({ghost})), *[frame(n, column(0, 0)) for n in (1, 2)]]
    (one,) = follow(frames, GRID, FPS)
    assert where(one, 0) == pytest.approx([0, 0], abs=0.05) and len(one.voxels) == 3


def coloured(code: int) -> np.ndarray:
    histogram = np.zeros((BANDS, LEVELS**3))
    histogram[:, code] = 10
    return histogram


def test_who_comes_back_is_known_by_the_colours() -> None:
    """Two leave; one of them returns."""
    here = [frame(n, column(-1, 0), column(1, 0)) for n in range(6)]
    back = [frame(n, column(0, 1.2)) for n in range(20, 26)]
    found = follow([*here, *[frame(n) for n in range(6, 20)], *back], GRID, FPS)
    assert len(found) == 3
    late = next(one for one in found if one.frames[0] == 20)
    left, right = (one for one in found if one is not late)
    left.colours, right.colours = {0: coloured(3)}, {0: coloured(9)}
    late.colours = {20: coloured(9)}
    assert set(join_returning(found, GRID, FPS)) == {left, right}
    assert (len(left.voxels), len(right.voxels)) == (6, 12)
    assert find_present_frames(right).tolist() == [*range(6), *range(20, 26)]
