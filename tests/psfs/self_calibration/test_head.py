"""Middles of a head, an ellipsoid whose outlines are exact conics, as measurements of cameras."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from psfs.cameras.camera import Camera, CameraRig
from psfs.diagnostics.frontier import SilhouetteContours
from psfs.diagnostics.small_views import Outline
from psfs.self_calibration import adjustment
from psfs.self_calibration.adjustment import Adjusted, PersonPoints
from psfs.self_calibration.config import AdjustmentConfig, HeadConfig
from psfs.self_calibration.head import HeadSections

UP, FRAMES = np.array([0, 0, 1.0]), 20
LAGS = np.array([0.0, 1.4, -0.7, 0.0])


def place(azimuth, height):
    """A camera 4 m from the middle."""
    centre = np.array([4 * np.cos(azimuth), 4 * np.sin(azimuth), height])
    forward = np.array([0, 0, 1.5]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, UP)
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    return Camera(f"{azimuth}", K, np.zeros(5), R, -R @ centre, (640, 480))


CAMERAS = [place(0.2, 1.3), place(1.6, 2.2), place(3.4, 1.7), place(4.9, 2.4)]


def outline(camera, time, axes):
    """The outline of an ellipsoid of semi-axes `axes`, m, that sways."""
    centre = np.array([0.3 * np.sin(0.4 * time), 0.25 * np.cos(0.3 * time), 1.6])
    dual = np.diag([*np.square(axes), 0.0]) - np.outer([*centre, 1], [*centre, 1])
    P = camera.K @ np.column_stack([camera.R, camera.t])
    conic = P @ dual @ P.T
    conic /= -conic[2, 2]
    middle = -conic[:2, 2]
    shape = np.linalg.cholesky(conic[:2, :2] + np.outer(middle, middle))
    angles = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    points = middle + np.stack([np.cos(angles), np.sin(angles)], -1) @ shape.T
    inside = np.zeros(len(points), bool)
    return Outline(points, inside, 1000, points, inside)


def contours(axes=(0.09, 0.09, 0.13)):
    return [
        SilhouetteContours([outline(camera, frame - lag, axes) for frame in range(FRAMES)])
        for camera, lag in zip(CAMERAS, LAGS, strict=True)
    ]


def turn(camera, angles):
    R = cv2.Rodrigues(np.array(angles))[0] @ camera.R
    return replace(camera, R=R, t=-R @ camera.centre)


@pytest.mark.parametrize(
    ("parameter", "wrong"),
    [(1, 0.005), (3, 0.03), (7, 0.3)],
    ids=["turned, rad", "beside, m", "late, frames"],
)
def test_an_error_of_one_camera_is_measured(parameter, wrong):
    """The measurements of all cameras give the correction of one parameter of the second."""
    cameras, lags = list(CAMERAS), LAGS.copy()
    if parameter == 1:
        cameras[1] = turn(cameras[1], [0, wrong, 0])
    elif parameter == 3:
        own = cameras[1]
        cameras[1] = replace(own, t=-own.R @ (own.centre + np.array([wrong, 0, 0])))
    else:
        lags[1] -= wrong
    head = HeadSections(cameras, lags, contours(), UP, HeadConfig())
    normal, gradient = head(cameras, lags)
    at = 8 + parameter
    assert -gradient[at] / normal[at, at] == pytest.approx(-wrong, rel=0.1)
    np.testing.assert_allclose(normal, normal.T, atol=1e-6 * normal.max())


def test_true_cameras_stay():
    head = HeadSections(CAMERAS, LAGS, contours(), UP, HeadConfig())
    normal, gradient = head(CAMERAS, LAGS)
    turns = np.array([8 * view + 1 for view in range(4)])
    assert np.abs(gradient[turns] / normal[turns, turns]).max() < 2e-4


def test_shoulders_are_no_head():
    head = HeadSections(CAMERAS, LAGS, contours((0.3, 0.3, 0.13)), UP, HeadConfig())
    normal, gradient = head(CAMERAS, LAGS)
    assert not normal.any()
    assert not gradient.any()


@pytest.mark.parametrize(("degrees", "used"), [(0.5, True), (2.0, False)])
def test_a_pass_that_turns_a_camera_far_is_undone(monkeypatch, degrees, used):
    near = Adjusted(CameraRig(tuple(CAMERAS)), LAGS, None)
    turned = turn(CAMERAS[2], [0, np.radians(degrees), 0])
    moved = Adjusted(CameraRig((*CAMERAS[:2], turned, CAMERAS[3])), LAGS, None)
    monkeypatch.setattr(
        adjustment, "settle", lambda start, points, ups=None: near if ups is None else moved
    )
    points = PersonPoints(CAMERAS, [[None]] * 4, AdjustmentConfig())
    assert adjustment.settle_by_head(near, points, [UP] * 4) is (moved if used else near)
