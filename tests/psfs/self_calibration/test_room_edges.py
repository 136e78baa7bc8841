"""Up and rotations of cameras from the edges of a room."""

import cv2
import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.common import least_squares
from psfs.diagnostics.refinement import correct_camera, correct_cameras
from psfs.self_calibration.adjustment import measure_turn
from psfs.self_calibration.room_edges import find_edges, find_room_edges, fit_vertical

#: What a person says: 5 degrees off.
LEAN = np.array([np.sin(0.07), -np.sin(0.05), 1.0])


def make_rig():
    cameras = []
    for k, (tilt, roll) in enumerate([(0.1, 0.2), (0.3, -0.1), (0.2, 0.05)]):
        turn = cv2.Rodrigues(np.array([0, 0, 2.0 * k]))[0]
        level = np.array([[1, 0, 0], [0, 0, -1.0], [0, 1, 0]])
        tipped = cv2.Rodrigues(np.array([0, 0, roll]))[0] @ cv2.Rodrigues(np.array([tilt, 0, 0]))[0]
        R = tipped @ level @ turn
        K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
        centre = turn.T @ np.array([0, -4.0, 1.5])
        cameras.append(Camera(f"c{k}", K, np.array([-0.1, 0, 0, 0, 0]), R, -R @ centre, (640, 480)))
    return CameraRig(tuple(cameras))


def make_edges(rig, rng, directions=(), each=10, others=30):
    """Each camera's edges, 0.2 px wrong: `each` along the directions, and others in any."""
    found = []
    for camera in rig:
        along = np.repeat(np.reshape(directions, (-1, 3)), each, axis=0)
        along = np.concatenate([along, rng.normal(size=(others, 3))])
        along *= 0.5 / np.linalg.norm(along, axis=1, keepdims=True)
        middles = rng.uniform([-1.2, -1.2, 0], [1.2, 1.2, 2], (len(along), 3))
        ends = camera.project(np.stack([middles - along, middles + along], 1))[0]
        found.append(ends + rng.normal(0, 0.2, ends.shape))
    return found


def test_upright_edges_of_all_cameras_tell_up():
    rig, rng = make_rig(), np.random.default_rng(1)
    up = fit_vertical(rig, make_edges(rig, rng, [0, 0, 1], 8), LEAN)
    assert np.degrees(np.arccos(up[2])) < 0.5


def test_edges_in_any_direction_tell_nothing():
    rig, rng = make_rig(), np.random.default_rng(2)
    assert fit_vertical(rig, make_edges(rig, rng), LEAN) is None
    assert fit_vertical(rig, [np.zeros((0, 2, 2))] * 3, LEAN) is None
    assert find_room_edges(rig, make_edges(rig, rng), LEAN) is None


def test_edges_of_a_picture_are_found_to_a_fraction_of_a_pixel():
    picture = np.full((240, 320, 3), 90, np.uint8)
    cv2.rectangle(picture, (100, 40), (160, 200), (200, 180, 60), cv2.FILLED)
    edges = find_edges(picture)
    upright = edges[np.abs(edges[:, 0, 0] - edges[:, 1, 0]) < 1]
    assert len(edges) == 4 and len(upright) == 2
    np.testing.assert_allclose(np.sort(upright[..., 0].mean(axis=1)), [100, 161], atol=1)


def turn_cameras(rig, rng):
    """The rig with cameras turned by half a degree about each axis, and refocused by 2 %."""
    steps = np.zeros((len(rig), 8))
    steps[:, :3] = rng.choice([-1, 1], (len(rig), 3)) * np.radians(0.5)
    return CameraRig(tuple(correct_camera(c, own) for c, own in zip(rig, steps, strict=True)))


def solve(rig, room, free):
    """The rig adjusted to the edges alone, its first camera held, in the `free` corrections."""
    steps = np.zeros((len(rig), 8), bool)
    steps[1:, free] = True
    further = room.bind()
    solution = least_squares.solve(
        lambda of: further.measure(correct_cameras(rig, of["cameras"]), np.zeros(len(rig)), of),
        {"cameras": np.zeros((len(rig), 8)), **further.start},
        free={"cameras": steps},
        steps=50,
    )
    return CameraRig(correct_cameras(rig, solution.parameters["cameras"]))


def test_walls_that_do_not_stand_square_tell_all_rotations():
    rig, rng = make_rig(), np.random.default_rng(1)
    walls = np.radians([20.0, 95.0])
    directions = [[0, 0, 1.0], *np.column_stack([np.cos(walls), np.sin(walls), [0, 0]])]
    edges = make_edges(rig, rng, directions, others=20)
    turned = turn_cameras(rig, rng)
    room = find_room_edges(turned, edges, LEAN)
    before, after = (
        np.degrees(measure_turn(of.cameras, rig.cameras))
        for of in (turned, solve(turned, room, slice(3)))
    )
    assert after < 0.3 * before


def test_edges_tell_a_focal_length():
    rig, rng = make_rig(), np.random.default_rng(4)
    edges = make_edges(rig, rng, np.eye(3), others=20)
    longer = np.zeros(8)
    longer[6] = 0.06
    cameras = CameraRig((*rig.cameras[:2], correct_camera(rig[2], longer)))
    found = solve(cameras, find_room_edges(cameras, edges, LEAN), [6])
    np.testing.assert_allclose(found[2].K[0, 0], 500, atol=8)
