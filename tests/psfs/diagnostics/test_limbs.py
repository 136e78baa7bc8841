"""Limbs' axes as measurements of cameras: of spheroids, whose outlines are exact conics."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers import scenes

from psfs.common.least_squares import solve
from psfs.diagnostics.frontier import SilhouetteContours
from psfs.diagnostics.limbs import LimbPoints, MedialAxes
from psfs.diagnostics.refinement import correct_cameras
from psfs.diagnostics.small_views import Outline

FRAMES = 12
LAGS = np.array([0.0, 1.4, -0.7, 0.0])
PERSON = np.array([0, 0, 1.2]), 1.7


PLACES = [(0.2, 3, 1.3), (1.6, 3, 2.2), (3.4, 3, 1.7), (4.9, 3, 2.4)]
CAMERAS = scenes.pinholes(PLACES, [0, 0, 1.2], (640, 480), 500.0)


def outline(camera, time, radius, wider):
    """The outline, `wider` px to either side, of a spheroid 1 m long that sways and turns."""
    axis = np.array([0.5 * np.sin(0.3 * time), 0.4 * np.cos(0.25 * time), 1.0])
    axis /= np.linalg.norm(axis)
    centre = np.array([0.3 * np.sin(0.4 * time), 0.25 * np.cos(0.3 * time), 1.2])
    shape = radius**2 * np.eye(3) + (0.5**2 - radius**2) * np.outer(axis, axis)
    dual = np.zeros((4, 4))
    dual[:3, :3] = shape
    dual -= np.outer([*centre, 1], [*centre, 1])
    P = camera.K @ np.column_stack([camera.R, camera.t])
    conic = P @ dual @ P.T
    conic /= -conic[2, 2]
    middle = -conic[:2, 2]
    root = np.linalg.cholesky(conic[:2, :2] + np.outer(middle, middle))
    angles = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], -1)
    normals = circle @ np.linalg.inv(root)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = middle + circle @ root.T + wider * normals
    inside = np.zeros(len(points), bool)
    return Outline(points, inside, 1000, points, inside)


@cache
def medial_axes(radius=0.06, wider=0.0):
    return [
        MedialAxes(
            camera,
            SilhouetteContours([outline(camera, t - lag, radius, wider) for t in range(FRAMES)]),
        )
        for camera, lag in zip(CAMERAS, LAGS, strict=True)
    ]


def find_points(cameras=CAMERAS, lags=LAGS, **shape):
    return LimbPoints(cameras, lags, medial_axes(**shape), *PERSON)


def measure(limbs, cameras, lags, free):
    """The corrections of `free` parameters of the cameras."""
    further, start = limbs.bind(lags), np.zeros((len(cameras), 8))

    def evaluate(of):
        corrected = correct_cameras(cameras, of["cameras"])
        return further.measure(corrected, of["cameras"][:, 7], of)

    found = solve(
        evaluate, {"cameras": start, **further.start}, free={"cameras": free}, eliminate=["limbs"],
    )  # fmt: skip
    return found.parameters["cameras"]


def only(view, parameter):
    mask = np.zeros((4, 8), bool)
    mask[view, parameter] = True
    return mask


@pytest.mark.parametrize(
    ("parameter", "wrong"),
    [(1, 0.005), (3, 0.03), (7, 0.1)],
    ids=["turned, rad", "beside, m", "late, frames"],
)
def test_an_error_of_one_camera_is_measured(parameter, wrong):
    """The measurements of all cameras give the correction of one parameter of the second."""
    cameras, lags = list(CAMERAS), LAGS.copy()
    if parameter == 1:
        cameras[1] = scenes.turned(cameras[1], [0, wrong, 0])
    elif parameter == 3:
        own = cameras[1]
        cameras[1] = replace(own, t=-own.R @ (own.centre + np.array([wrong, 0, 0])))
    else:
        lags[1] -= wrong
    found = measure(find_points(cameras, lags), cameras, lags, only(1, parameter))
    assert found[1, parameter] == pytest.approx(-wrong, rel=0.25)


def test_true_cameras_stay_however_wide_the_silhouettes_are():
    limbs = find_points(wider=1.5)
    assert len(limbs) > 500
    for view in (1, 3):  # one is late, one is in time
        found = measure(limbs, CAMERAS, LAGS, only(view, 1))
        assert abs(found[view, 1]) < 3e-4


def test_a_trunk_is_no_limb():
    assert not len(find_points(radius=0.16))
