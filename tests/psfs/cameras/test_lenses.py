"""Lenses: distortion, its derivatives and inverse; rays, and pictures at other scales."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from helpers import calibration as made

from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.distortion import (
    distort,
    distortion_jacobian,
    largest_radius2,
    undistort,
)
from psfs.diagnostics.small_views import Shrink
from psfs.sequence import Frame

BROWN = [np.zeros(5), np.array([-0.3, 0.1, 1e-3, -2e-3, 0.0]), np.array([0.1, 0, 0, 0.01, -0.02])]
FISHEYE = [np.array([*k, 0, 0, 1.0]) for k in ((-0.02, 0.01, -5e-3, 1e-3), (0.05, 0.0, 0.0, 0.0))]
LENSES = [*BROWN, *FISHEYE, np.array([0, 0, 0, 0, 0, 0.7]), np.array([0, 0, 0, 0, 0, -0.1])]


@pytest.mark.parametrize("lens", [*BROWN, *FISHEYE])
def test_it_is_opencvs(lens: np.ndarray) -> None:
    x, y = np.random.default_rng(0).uniform(-2, 2, (2, 50)) * (1 if len(lens) > 5 else 0.3)
    points, pose = np.column_stack([x, y, np.ones(50)])[:, None], (np.zeros(3), np.zeros(3))
    if len(lens) > 5:
        expected = cv2.fisheye.projectPoints(points, *pose, np.eye(3), lens[:4])[0][:, 0]
    else:
        expected = cv2.projectPoints(points, *pose, np.eye(3), lens)[0][:, 0]
    np.testing.assert_allclose(np.column_stack(distort(lens, x, y)), expected, atol=1e-12)


@pytest.mark.parametrize("lens", LENSES)
def test_its_derivatives(lens: np.ndarray) -> None:
    x, y = np.random.default_rng(1).uniform(-0.6, 0.6, (2, 50))
    step = 1e-6
    by_x = np.subtract(distort(lens, x + step, y), distort(lens, x - step, y)) / (2 * step)
    by_y = np.subtract(distort(lens, x, y + step), distort(lens, x, y - step)) / (2 * step)
    jacobian = distortion_jacobian(lens, x, y)
    np.testing.assert_allclose(jacobian[:, 0], by_x, atol=1e-8)
    np.testing.assert_allclose(jacobian[:, 1], by_y, atol=1e-8)


@pytest.mark.parametrize("lens", LENSES)
def test_it_is_undone_but_beyond_what_the_lens_shows(lens: np.ndarray) -> None:
    x, y = np.random.default_rng(2).uniform(-0.6, 0.6, (2, 50))
    found = undistort(lens, *distort(lens, x, y))
    np.testing.assert_allclose(found, [x, y], atol=1e-9)
    edge = largest_radius2(lens) ** 0.5
    if np.isfinite(edge):
        far = np.array([1.2 * edge])
        assert np.isnan(undistort(lens, far, far)).all()
    assert np.isnan(undistort(lens, np.array([np.nan]), np.array([0.0]))).all()


def test_where_it_turns_back() -> None:
    # a (1 - a^2 / 3) of a fisheye lens turns at an angle of 1 rad.
    edge = largest_radius2(np.array([-1 / 3, 0, 0, 0, 0, 0, 1]))
    assert edge == pytest.approx(np.tan(1) ** 2)
    assert largest_radius2(np.zeros(5)) == np.inf
    # r (1 - 0.3 r^2) turns where 1 = 0.9 r^2.
    assert largest_radius2(np.array([-0.3, 0, 0, 0, 0])) == pytest.approx(1 / 0.9, rel=1e-3)


CAMERA = made.ring(1, size=(320, 180))[0]
#: Sides whose small pictures must be rounded, one of each in either direction.
ODD = CameraRig((replace(CAMERA, size=(129, 97)), replace(CAMERA, name="b", size=(75, 66))))
STRONG = np.array([-0.35, 0.15, 1e-3, -1e-3, -0.02])


def ramps(rig: CameraRig) -> np.ndarray:
    """(V, H, W, 2): each pixel's own column and row."""
    own = np.stack(np.meshgrid(np.arange(rig.width), np.arange(rig.height)), -1)
    return np.stack([own.astype(np.float32)] * len(rig))


def test_small_pictures_are_to_the_scale_of_their_cameras() -> None:
    factor = ODD.factor_within(40)
    assert factor == 40 / 129
    found = Shrink(ODD, factor).frame(Frame(0, ramps(ODD), None)).images
    assert found is not None and found.shape == (2, 30, 40, 2)
    small = ODD.scaled(factor)
    for shown, camera in zip(found, small, strict=True):
        width, height = camera.size
        place = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1)
        away = factor * (shown[:height, :width] + 0.5) - 0.5 - place
        assert np.abs(away[:-1, :-1]).max() < 0.01  # px; the last are cut or seen in part
        assert not shown[height:].any() and not shown[:, width:].any()


@pytest.mark.parametrize("skew", [0.0, 0.7])
def test_rays_meet_what_the_lens_shows_at_their_pixels(skew: float) -> None:
    K = CAMERA.K + skew * np.eye(3, k=1) * [[1], [0], [0]]
    pixels = np.random.default_rng(0).uniform(0, CAMERA.size, (200, 2))
    camera = Camera("c", K, STRONG, CAMERA.R, CAMERA.t, CAMERA.size)
    found, depth = camera.project(camera.centre + 2 * camera.rays(pixels))
    np.testing.assert_allclose(found, pixels, atol=1e-6)
    np.testing.assert_allclose(depth, 2)
    # Beyond the circle that the lens shows OpenCV's approximation takes over.
    assert np.isfinite(camera.rays(np.array([[5000.0, 90.0]]))).all()
    plain = Camera("c", K, np.zeros(5), CAMERA.R, CAMERA.t, CAMERA.size)
    straight = pixels.copy()
    straight[:, 0] -= K[0, 1] * (straight[:, 1] - K[1, 2]) / K[1, 1]
    expected = cv2.undistortPoints(straight[:, None], K, np.zeros(5)).reshape(-1, 2)
    np.testing.assert_array_equal(plain.normalise(pixels), expected)
