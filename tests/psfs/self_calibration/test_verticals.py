"""Up from the vertical edges of a room."""

import cv2
import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.self_calibration.config import VerticalConfig
from psfs.self_calibration.verticals import find_edges, fit_vertical

CONFIG = VerticalConfig()
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


def make_edges(rig, rng, vertical):
    """Each camera's edges, 0.4 px wrong: 30 in any direction, `vertical` upright ones."""
    found = []
    for camera in rig:
        along = rng.normal(size=(30 + vertical, 3))
        along[:vertical] = [0, 0, 1]
        along *= 0.3 / np.linalg.norm(along, axis=1, keepdims=True)
        middles = rng.uniform([-1.2, -1.2, 0.5], [1.2, 1.2, 1.8], (len(along), 3))
        ends = camera.project(np.stack([middles - along, middles + along], 1))[0]
        found.append(ends + rng.normal(0, 0.4, ends.shape))
    return found


def test_upright_edges_of_all_cameras_tell_up():
    rig, rng = make_rig(), np.random.default_rng(1)
    up = fit_vertical(rig, make_edges(rig, rng, 8), LEAN, CONFIG)
    assert np.degrees(np.arccos(up[2])) < 0.5


def test_edges_in_any_direction_tell_nothing():
    rig, rng = make_rig(), np.random.default_rng(2)
    assert fit_vertical(rig, make_edges(rig, rng, 0), LEAN, CONFIG) is None
    assert fit_vertical(rig, [np.zeros((0, 2, 2))] * 3, LEAN, CONFIG) is None


def test_edges_of_a_picture_are_found_to_a_fraction_of_a_pixel():
    picture = np.full((240, 320, 3), 90, np.uint8)
    cv2.rectangle(picture, (100, 40), (160, 200), (200, 180, 60), cv2.FILLED)
    edges = find_edges(picture, CONFIG)
    upright = edges[np.abs(edges[:, 0, 0] - edges[:, 1, 0]) < 1]
    assert len(edges) == 4 and len(upright) == 2
    np.testing.assert_allclose(np.sort(upright[..., 0].mean(axis=1)), [100, 161], atol=1)
