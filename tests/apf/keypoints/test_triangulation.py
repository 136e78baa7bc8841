"""Triangulation of keypoints, some of which are wrong."""

import numpy as np
from helpers import scenes
from helpers.keypoints import of_poses, world_points

from apf.body.toml import load_body
from apf.keypoints.keypoints import TriangulationConfig, triangulate
from apf.keypoints.readers.orders import MEDIAPIPE

RIG = scenes.ring(5, size=(640, 480))
BODY = load_body("song31")
POSES = np.tile(BODY.rest_pose, (3, 1)) + [[0.1 * f] + 30 * [0] for f in range(3)]
TRUTH = world_points(BODY, POSES, MEDIAPIPE)


def seen(noise: float = 0.0) -> np.ndarray:
    return of_poses(RIG, BODY, POSES, noise=noise).undistort(RIG).points.astype(float)


def test_wrong_cameras_are_left_out() -> None:
    points = seen(noise=0.5)
    points[1, :, 5, :2] += [120, -40]
    points[3, 0, 5, 0] -= 200
    found = triangulate(RIG, points)
    assert np.linalg.norm(found.points - TRUTH, axis=-1).max() < 0.01
    assert not found.used[1, :, 5].any() and not found.used[3, 0, 5]
    assert found.used.sum() == found.used.size - 4 and (found.errors < 15).all()
    kept = triangulate(RIG, points, TriangulationConfig(max_error=1e4))
    assert kept.used.all() and np.linalg.norm(kept.points - TRUTH, axis=-1)[0, 5] > 0.1


def test_too_few_or_disagreeing_cameras_give_no_point() -> None:
    points = seen()
    points[1:, 0, 0] = np.nan
    points[2:, 0, 1] = np.nan
    points[3:, 0, 2, 2] = 0.01  # below what counts
    points[2:, 1, 0] = np.nan
    points[1, 1, 0, :2] += 300
    found = triangulate(RIG, points)
    assert np.isnan(found.points[0, 0]).all() and np.isnan(found.errors[0, 0])
    assert np.isnan(found.points[1, 0]).all() and not found.used[:, 1, 0].any()
    np.testing.assert_allclose(found.points[0, 1:], TRUTH[0, 1:], atol=1e-4)
    assert found.used[:, 0, 2].tolist() == [True, True, True, False, False]
    three = triangulate(RIG, points, TriangulationConfig(min_cameras=3))
    assert np.isnan(three.points[0, 1]).all() and np.isfinite(three.points[0, 2]).all()


def test_a_point_behind_a_camera_does_not_count() -> None:
    behind = RIG[0].centre - 2.0 * RIG[0].R[2]
    rig = scenes.without_distortion(RIG.subset(["c0", "c1"]))
    local = np.stack([camera.K @ (camera.R @ behind + camera.t) for camera in rig])
    pixels = np.column_stack([local[:, :2] / local[:, 2:], [1.0, 1.0]])
    assert np.isnan(triangulate(rig, pixels[:, None]).points).all()
