"""Derivatives of points on the body compared with finite differences."""

import numpy as np
import pytest
from helpers import bodies

from apf.body.jacobian import bone_point_jacobian, cone_moves, distance_jacobian
from apf.body.kinematics import bone_matrices, posed_cones
from apf.body.model import BodyModel

NAMES = ("song31", "stick", "rymut31_lower")
STEP = 1e-6


def stepped(body: BodyModel, pose: np.ndarray) -> np.ndarray:
    """Return poses (D, D), each with another degree of freedom moved by STEP."""
    return pose + STEP * np.eye(body.n_dof)


@pytest.mark.parametrize("name", NAMES)
def test_which_cones_a_degree_of_freedom_slides_or_turns(name: str) -> None:
    body = bodies.named(name)
    pose = bodies.random_poses(body, 1)[0]
    moved = posed_cones(body, stepped(body, pose)) - posed_cones(body, pose[None])
    shifts = np.abs(moved[..., :8]).max(-1).T > 0.01 * STEP  # of the ends
    turns = np.abs(moved[..., 8:]).max(-1).T > 0.01 * STEP  # of the directions
    moves = cone_moves(body)
    np.testing.assert_array_equal(moves > 0, shifts | turns)
    np.testing.assert_array_equal(moves == 2, turns)


@pytest.mark.parametrize("name", NAMES)
def test_points_fixed_to_bones_move_as_stated(name: str) -> None:
    body = bodies.named(name)
    pose = bodies.random_poses(body, 1)[0]
    random = np.random.default_rng(3)
    bone = random.integers(len(body.bones), size=50)
    local = random.normal(0, 0.2, (50, 3))  # in the frames of the bones

    def points(poses: np.ndarray) -> np.ndarray:
        rotations, origins = bone_matrices(body, poses)
        return origins[:, bone] + np.einsum("nkab,kb->nka", rotations[:, bone], local)

    here = points(pose[None])[0]
    slopes = (points(stepped(body, pose)) - here) / STEP
    found = bone_point_jacobian(body, pose[None], bone, here[None])[0]
    np.testing.assert_allclose(found, slopes.swapaxes(0, 1), atol=1e-4)


@pytest.mark.parametrize("name", ["song31", "stick"])
def test_distances_to_the_nearest_cone_change_as_stated(name: str) -> None:
    body = bodies.named(name)
    pose = bodies.random_poses(body, 1)[0]
    points = bodies.surface_points(body, pose, 100) + np.random.default_rng(0).normal(
        0, 0.02, (100, 3)
    )
    distance, rows = distance_jacobian(body, pose, points)
    for dof in range(body.n_dof):
        moved = distance_jacobian(body, stepped(body, pose)[dof], points)[0]
        slopes = (moved - distance) / STEP
        # A point between two cones may change to the other.
        assert np.mean(np.abs(slopes - rows[:, dof]) < 1e-4) > 0.97, body.dof_names[dof]
