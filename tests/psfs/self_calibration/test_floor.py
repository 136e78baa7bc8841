"""The floor below feet, and below feet in their shadow."""

import cv2
import numpy as np
import pytest
from helpers import scenes

from psfs.cameras.camera import Camera, CameraRig
from psfs.diagnostics.frontier import SilhouetteContours
from psfs.diagnostics.small_views import extract_outline
from psfs.self_calibration.world import fit_floor, measure_floor

PLACES = [(1.6 * k, 3.8, 1.65 + 0.18 * k) for k in range(4)]
RIG = CameraRig(tuple(scenes.pinholes(PLACES, [0, 0, 0.5], (640, 480), 420.0)))


def draw(camera, x, shadow):
    """Two legs on feet whose soles are at Z = 0, at some x, m, and perhaps their shadow."""
    mask = np.zeros((480, 640), np.uint8)

    def fill(points):
        pixels = camera.project(points)[0].astype(np.float32)
        cv2.fillConvexPoly(mask, cv2.convexHull(pixels).astype(np.int32), 1)

    corners = np.stack(np.meshgrid([-1, 1], [-1, 1], [0, 1]), -1).reshape(-1, 3)
    for y in (-0.12, 0.12):
        fill(np.array([x, y, 0]) + corners * [0.12, 0.045, 0.08])
        fill(np.array([x - 0.07, y, 0.05]) + corners * [0.05, 0.045, 0.8])
    fill(np.array([x - 0.07, 0, 0.85]) + corners * [0.1, 0.17, 0.6])
    if shadow:
        angles = np.linspace(0, 2 * np.pi, 40)
        fill(np.array([x, 0, 0]) + 0.3 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], -1))
    return mask > 0


@pytest.mark.parametrize("shadow", [False, True])
@pytest.mark.parametrize("height", [0.06, -0.1])
def test_the_floor_is_found_with_and_without_a_shadow(shadow, height):
    places = np.array([[-0.3, 0], [0.2, 0]])
    contours = [
        SilhouetteContours([extract_outline(draw(camera, x, shadow)) for x, _ in places])
        for camera in RIG
    ]
    moved = [
        Camera(c.name, c.K, c.distortion, c.R, c.t - c.R @ np.array([0, 0, height]), c.size)
        for c in RIG
    ]
    frames, shifts = np.array([5, 6]), np.full(4, -5)
    found = measure_floor(CameraRig(tuple(moved)), contours, shifts, frames, places)
    assert abs(found - height) < (0.011 if shadow else 0.035)  # hulls bulge below soles


def test_nobody_tells_no_floor():
    contours = [SilhouetteContours([None])] * 4
    zeros = np.zeros(4, int)
    assert measure_floor(RIG, contours, zeros, zeros[:1], np.zeros((1, 2))) == 0


def test_hands_that_are_lowest_do_not_tilt_the_floor():
    rng = np.random.default_rng(3)
    low = np.column_stack([rng.uniform(-1.6, 1.6, (160, 2)), rng.normal(0, 0.015, 160)])
    low[:, 2] += 0.03 * low[:, 0] - 0.02 * low[:, 1]
    low[low[:, 0] > 1.2, 2] += 0.9  # at one end of the walk the feet are not seen
    assert 10 < (low[:, 2] > 0.5).sum() < 40
    np.testing.assert_allclose(fit_floor(low), [-0.03, 0.02, 1], atol=0.004)
