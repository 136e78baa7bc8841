"""Persons of several cameras assigned to people, whatever their order, and to those in voxels."""

from typing import Any

import numpy as np
from helpers import bodies, scenes
from helpers.keypoints import of_poses

from apf.body.kinematics import posed_joints
from apf.body.toml import load_body
from apf.keypoints.association import associate_people, count_at_once, match_to_people
from psfs.people.people import People, Person
from psfs.voxels.grid import VoxelGrid

RIG = scenes.ring(4, size=(640, 480), radius=5.0)
BODY = load_body("song31")
FRAMES, FPS = 24, 12.0
NEAR = scenes.ring(4, size=(640, 480))
GRID = VoxelGrid.covering(np.array([-1.5, -1.5, 0.0]), np.array([1.5, 1.5, 2.0]), 0.08)


def walker(start: tuple[float, float], step: tuple[float, float], **options: Any) -> np.ndarray:
    """Return the keypoints (V, F, K, 3) of a body that moves on a line."""
    x, y = (start[axis] + step[axis] * np.arange(FRAMES) for axis in (0, 1))
    rest = np.tile(BODY.rest_pose, (FRAMES, 1))
    poses = bodies.bent(BODY, rest, pelvis__tx=x, pelvis__ty=y)
    return of_poses(RIG, BODY, poses, **options).points.astype(float)


def shuffled(people: list[np.ndarray], seed: int = 0) -> np.ndarray:
    """Return (V, F, N, K, 3): the people of each picture in an order of its own."""
    stacked = np.stack(people, axis=2)
    random = np.random.default_rng(seed)
    for view, frame in np.ndindex(stacked.shape[:2]):
        stacked[view, frame] = stacked[view, frame, random.permutation(len(people))]
    return stacked


def same(found: np.ndarray, true: np.ndarray) -> float:
    """Return the share of a person's keypoints that were given to the person."""
    known = np.isfinite(true)
    return float((found[known] == true[known]).mean())


def test_people_who_pass_one_another_are_kept_apart() -> None:
    people = [
        walker((-1.0, -0.4), (0.08, 0), noise=1.5),
        walker((1.0, 0.4), (-0.08, 0), noise=1.5, seed=1),
        walker((0.0, 1.4), (0.0, 0.0), noise=1.5, seed=2),
    ]
    found = associate_people(shuffled(people), RIG, FPS)
    assert len(found) == 3
    shares = np.array([[same(own, true) for true in people] for own in found])
    assert shares.max(1).min() > 0.98
    assert sorted(shares.argmax(1)) == [0, 1, 2]


def test_who_leaves_comes_back_as_the_same_person_and_so_many_are_followed_at_most() -> None:
    first, second = walker((-0.8, 0), (0, 0)), walker((0.8, 0), (0, 0.01))
    second[:, 8:18] = np.nan
    found = associate_people(shuffled([first, second]), RIG, FPS)
    assert [same(own, true) for own, true in zip(found, (first, second), strict=True)] == [1, 1]
    assert [count_at_once(found, least) for least in (1, 14, 15)] == [2, 2, 1]
    assert associate_people(shuffled([first, second]) * np.nan, RIG, FPS) == []
    assert len(associate_people(shuffled([first, second]), RIG, FPS, number=1)) == 1


def test_a_rejected_match_does_not_split_a_person_who_returns() -> None:
    """In one frame four cameras agree on only three of five points, so that the match is rejected;
    a person who returns near these points later is still one person."""
    person, back = walker((-0.8, 0), (0, 0)), walker((0.5, 0), (0, 0))
    person[:, 8:17] = np.nan
    person[:, 17:] = back[:, 17:]
    nobody = np.full_like(person, np.nan)
    heads = np.array([[0.6, 0, 1.4], [0.65, 0.05, 1.45], [0.55, -0.05, 1.45]])
    for view, (camera, height, off) in enumerate(
        zip(RIG, (0.2, 0.2, 1.2, 1.2), (13, -13, 20, -20), strict=True)
    ):
        feet = np.array([[0.6, 0, height], [0.65, 0.05, height]])
        pixels, _ = camera.project(np.concatenate([heads, feet]))
        pixels[3:, 1] += off
        nobody[view, 9, :5] = np.column_stack([pixels, np.ones(5)])
    (found,) = associate_people(np.stack([person, nobody], axis=2), RIG, FPS)
    assert same(found, person) == 1


def test_a_camera_without_a_person_and_persons_of_one_camera() -> None:
    """Somebody in a single camera, such as a picture on the wall, is nobody; one camera may miss a
    person."""
    person, poster = walker((0, 0), (0.02, 0)), walker((1.0, 1.0), (0, 0))
    person[1, 5:9] = np.nan
    poster[1:] = np.nan
    (found,) = associate_people(shuffled([person, poster]), RIG, FPS)
    assert same(found, person) == 1
    assert np.isnan(found[1, 5:9]).all()


def walk(side: float) -> np.ndarray:
    """Poses (6, D) of somebody who walks along x at y = side."""
    rest = np.tile(BODY.rest_pose, (6, 1))
    return bodies.bent(BODY, rest, pelvis__tx=0.05 * np.arange(6), pelvis__ty=side)


def voxels_of(poses: np.ndarray) -> Person:
    """The coarse voxels within 15 cm of each frame's joints."""
    found = {}
    for frame, joints in enumerate(posed_joints(BODY, poses)):
        away = np.linalg.norm(GRID.centres()[:, None] - joints, axis=-1).min(1)
        found[frame] = np.flatnonzero(away < 0.15)
    return Person(np.arange(6), found)


def test_identities_that_pictures_exchange_are_put_right() -> None:
    walks = [walk(-0.5), walk(0.5)]
    true = [of_poses(NEAR, BODY, poses) for poses in walks]
    people = People(range(6), GRID, tuple(map(voxels_of, walks)))
    exchanged = [one.points.copy() for one in true]
    for one, other in ((0, 1), (1, 0)):
        exchanged[one][:, 3:] = true[other].points[:, 3:]
    exchanged[1][:, 2] = np.nan  # unseen there
    first, second = match_to_people(np.stack(exchanged), people, NEAR)
    np.testing.assert_array_equal(first, true[0].points)
    expected = true[1].points.copy()
    expected[:, 2] = np.nan
    np.testing.assert_array_equal(second, expected)
    aside = of_poses(NEAR, BODY, walk(1.5))  # far from all voxels
    nobodys = match_to_people(aside.points[None], people, NEAR)
    assert all(np.isnan(points).all() for points in nobodys)
