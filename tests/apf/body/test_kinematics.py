"""Forward kinematics: the twin compared with matrix products, the kernel with the twin."""

import numpy as np
import pytest
from helpers import bodies

from apf.body.kinematics import (
    bone_matrices,
    posed_cones,
    posed_joints,
)
from apf.body.model import BodyModel
from apf.body.posing import Kinematics
from cl import Device

BODIES = ["song31", "stick"]


def transform(kind: str, value: float) -> np.ndarray:
    """Return the matrix (4, 4) of one axis."""
    c, s = np.cos(value), np.sin(value)
    matrix = np.eye(4)
    if kind[0] == "t":
        matrix["xyz".index(kind[1]), 3] = value
    else:
        matrix[:3, :3] = {
            "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
            "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        }[kind[1]]
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


def launched(device: Device, body: BodyModel, poses: np.ndarray) -> np.ndarray:
    kinematics = Kinematics(device, body, len(poses))
    kinematics.cones.fill(-7)
    for launch in kinematics.launcher(device.to_device(poses.astype(np.float32))):
        launch()
    return kinematics.cones.get()


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
    np.testing.assert_allclose(
        launched(device, body, poses), posed_cones(body, poses), rtol=1e-4, atol=1e-5
    )
