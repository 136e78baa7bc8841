"""Keypoints of several people are given to the people in the voxels."""

import numpy as np
from helpers import scenes
from helpers.keypoints import of_poses

from apf.body.kinematics import posed_joints
from apf.body.toml import load_body
from apf.keypoints.association import match_to_people
from psfs.people.people import People, Person
from psfs.voxels.grid import VoxelGrid

FRAMES = 6
GRID = VoxelGrid.covering(np.array([-1.5, -1.5, 0.0]), np.array([1.5, 1.5, 2.0]), 0.08)
BODY = load_body("song31")


def walk(side: float) -> np.ndarray:
    """Poses (F, D) of somebody who walks along x at y = side."""
    poses = np.tile(BODY.rest_pose, (FRAMES, 1))
    poses[:, 0] += 0.05 * np.arange(FRAMES)
    poses[:, 1] += side
    return poses


def voxels_of(poses: np.ndarray) -> Person:
    """The coarse voxels within 15 cm of each frame's joints."""
    found = {}
    for frame, joints in enumerate(posed_joints(BODY, poses)):
        away = np.linalg.norm(GRID.centres()[:, None] - joints, axis=-1).min(1)
        found[frame] = np.flatnonzero(away < 0.15)
    return Person(np.arange(FRAMES), found)


def test_identities_that_pictures_exchange_are_put_right() -> None:
    rig = scenes.ring(4, size=(640, 480))
    walks = [walk(-0.5), walk(0.5)]
    true = [of_poses(rig, BODY, poses) for poses in walks]
    people = People(range(FRAMES), GRID, tuple(map(voxels_of, walks)))
    exchanged = [one.points.copy() for one in true]
    for one, other in ((0, 1), (1, 0)):
        exchanged[one][:, 3:] = true[other].points[:, 3:]
    exchanged[1][:, 2] = np.nan  # unseen there
    first, second = match_to_people(np.stack(exchanged), people, rig)
    np.testing.assert_array_equal(first, true[0].points)
    expected = true[1].points.copy()
    expected[:, 2] = np.nan
    np.testing.assert_array_equal(second, expected)


def test_keypoints_far_from_the_voxels_are_nobodys() -> None:
    rig = scenes.ring(4, size=(640, 480))
    people = People(range(FRAMES), GRID, (voxels_of(walk(-1.0)), voxels_of(walk(0.0))))
    aside = of_poses(rig, BODY, walk(1.0))
    given = aside.points[None]
    assert all(np.isnan(points).all() for points in match_to_people(given, people, rig))
