"""Forward kinematics: matrix products, kernel, derivatives; trunk and limbs, inverse kinematics."""

import numpy as np
import pytest
from helpers import bodies
from scipy.spatial.transform import Rotation

from apf.body.jacobian import bone_point_jacobian, cone_moves, distance_jacobian
from apf.body.kinematics import bone_matrices, posed_cones, posed_joints
from apf.body.limbs import add_ankles, limb_joints, limb_masks, limb_names, solve_inverse_kinematics
from apf.body.model import BodyModel
from apf.body.posing import Kinematics
from apf.body.stature import stature
from apf.body.toml import format_body, load_body, parse_body
from cl import Device

SONG = load_body("song31")
BODIES = ["song31", "stick"]


def transform(kind: str, value: float) -> np.ndarray:
    """Return the matrix (4, 4) of one axis."""
    matrix = np.eye(4)
    if kind[0] == "t":
        matrix["xyz".index(kind[1]), 3] = value
    else:
        matrix[:3, :3] = Rotation.from_euler(kind[1], value).as_matrix()
    return matrix


def world_matrices(body: BodyModel, pose: np.ndarray) -> list[np.ndarray]:
    """Compute W = W_parent T(offset) rest A_1 A_2 ... as products of (4, 4) matrices."""
    world: list[np.ndarray] = []
    for bone in body.bones:
        local = np.eye(4)
        local[:3, 3] = bone.offset
        turned = np.eye(4)
        turned[:3, :3] = bone.rest
        matrix = (world[bone.parent] if bone.parent >= 0 else np.eye(4)) @ local @ turned
        for axis in bone.axes:
            matrix = matrix @ transform(axis.kind, axis.sign * pose[axis.dof])
        world.append(matrix)
    return world


@pytest.mark.parametrize("name", BODIES)
def test_twin_is_the_product_of_matrices(name: str) -> None:
    body = bodies.named(name)
    poses = bodies.random_poses(body, 7, wild=True)
    rotations, origins = bone_matrices(body, poses)
    joints, cones = posed_joints(body, poses), posed_cones(body, poses)
    for n, pose in enumerate(poses):
        world = world_matrices(body, pose)
        np.testing.assert_allclose(rotations[n], [w[:3, :3] for w in world], atol=1e-12)
        np.testing.assert_allclose(origins[n], [w[:3, 3] for w in world], atol=1e-12)
        for j, joint in enumerate(body.joints):
            expected = world[joint.bone] @ [*joint.position, 1]
            np.testing.assert_allclose(joints[n, j], expected[:3], atol=1e-12)
        for c, cone in enumerate(body.cones):
            for place, end in ((0, cone.start), (4, cone.end)):
                expected = world[cone.bone] @ [*end, 1]
                np.testing.assert_allclose(cones[n, c, place : place + 3], expected[:3], atol=1e-12)


@pytest.mark.parametrize("name", BODIES)
def test_sections_are_square_to_their_cones(name: str) -> None:
    """A posed cone's two section axes are normal to its axis and to each other, right-handed."""
    body = bodies.named(name)
    cones = posed_cones(body, bodies.random_poses(body, 20, wild=True))
    axis, x, y = cones[..., 4:7] - cones[..., 0:3], cones[..., 8:11], cones[..., 12:15]
    for a, b in ((axis, x), (axis, y), (x, y)):
        np.testing.assert_allclose(np.sum(a * b, -1), 0, atol=1e-12)
    assert np.all(np.sum(np.cross(x, y) * axis, -1) > 0)
    for c, cone in enumerate(body.cones):
        np.testing.assert_allclose(1 / np.linalg.norm(x[:, c], axis=-1), cone.scale[0])
        np.testing.assert_allclose(1 / np.linalg.norm(y[:, c], axis=-1), cone.scale[1])
        np.testing.assert_allclose(cones[:, c, [3, 7]], np.tile(cone.radii, (20, 1)))


@pytest.mark.parity("tracking/kinematics.pose_cones")
@pytest.mark.parametrize("n_particles", [1, 37, 129])
@pytest.mark.parametrize("name", BODIES)
def test_kernel_agrees_with_the_twin(device: Device, name: str, n_particles: int) -> None:
    body = bodies.named(name)
    poses = bodies.random_poses(body, n_particles, seed=n_particles, wild=True)
    poses = poses.astype(np.float32)
    kinematics = Kinematics(device, body, len(poses))
    kinematics.cones.fill(-7)
    for launch in kinematics.launcher(device.to_device(poses)):
        launch()
    expected = posed_cones(body, poses)
    np.testing.assert_allclose(kinematics.cones.get(), expected, rtol=1e-4, atol=1e-5)


# Derivatives against finite differences ---------------------------------------------------------

MOVED = ("song31", "stick", "rymut31_lower")
STEP = 1e-6


def stepped(body: BodyModel, pose: np.ndarray) -> np.ndarray:
    """Return poses (D, D), each with another degree of freedom moved by STEP."""
    return pose + STEP * np.eye(body.n_dof)


@pytest.mark.parametrize("name", MOVED)
def test_cones_slide_and_turn_and_points_on_bones_move_as_stated(name: str) -> None:
    body = bodies.named(name)
    pose = bodies.random_poses(body, 1)[0]
    moved = posed_cones(body, stepped(body, pose)) - posed_cones(body, pose[None])
    shifts = np.abs(moved[..., :8]).max(-1).T > 0.01 * STEP  # of the ends
    turns = np.abs(moved[..., 8:]).max(-1).T > 0.01 * STEP  # of the directions
    moves = cone_moves(body)
    np.testing.assert_array_equal(moves > 0, shifts | turns)
    np.testing.assert_array_equal(moves == 2, turns)
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
    off = np.random.default_rng(0).normal(0, 0.02, (100, 3))
    points = bodies.surface_points(body, pose, 100) + off
    distance, rows = distance_jacobian(body, pose, points)
    for dof in range(body.n_dof):
        moved = distance_jacobian(body, stepped(body, pose)[dof], points)[0]
        slopes = (moved - distance) / STEP
        # A point between two cones may change to the other.
        assert np.mean(np.abs(slopes - rows[:, dof]) < 1e-4) > 0.97, body.dof_names[dof]


def test_a_limb_reaches_for_places() -> None:
    """Inverse kinematics respects limits, gets as near as possible, and leaves what is in place."""
    limbs, joints = limb_masks(SONG), limb_joints(SONG)
    poses = np.tile(SONG.rest_pose, (len(limbs), 1))
    wanted = np.where(limbs, poses + 0.3, poses).clip(SONG.lower, SONG.upper)
    targets = posed_joints(SONG, wanted)
    found = solve_inverse_kinematics(SONG, poses, limbs, joints, targets)
    away = np.linalg.norm(posed_joints(SONG, found) - targets, axis=-1)
    assert away[joints].max() < 0.01
    np.testing.assert_array_equal(found[~limbs], poses[~limbs])
    np.testing.assert_array_equal(
        solve_inverse_kinematics(SONG, wanted, limbs, joints, targets), wanted
    )
    far = solve_inverse_kinematics(SONG, poses, limbs, joints, targets + 9.0)
    assert np.all((far >= SONG.lower) & (far <= SONG.upper)) and np.isfinite(far).all()


@pytest.mark.parametrize("name", ["song31", "song32", "rymut31", "rymut31_lower"])
def test_feet_turn_about_ankles(name: str) -> None:
    """Nothing else changes, neither in files nor if ankles are added once more."""
    body = bodies.named(name)
    footed = parse_body(format_body(add_ankles(body)), "footed")
    assert add_ankles(footed) is not None and add_ankles(footed).n_dof == footed.n_dof
    poses = bodies.random_poses(body, 2)
    padded = np.pad(poses, ((0, 0), (0, footed.n_dof - body.n_dof)))
    np.testing.assert_allclose(posed_joints(footed, padded), posed_joints(body, poses), atol=1e-9)
    np.testing.assert_allclose(posed_cones(footed, padded), posed_cones(body, poses), atol=1e-9)
    assert limb_names(footed) == limb_names(body)
    assert stature(footed) == pytest.approx(stature(body))
    turned = bodies.bent(footed, padded, l_foot__ry=0.3)
    moved = np.abs(posed_cones(footed, turned) - posed_cones(footed, padded)).max((0, 2)) > 1e-3
    assert {footed.cone_names[k] for k in np.flatnonzero(moved)} == {"l_foot"}
