"""Resized pictures lie where the scaled cameras say, and rays are exact."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from helpers import calibration as made

from psfs.cameras.camera import Camera, CameraRig
from psfs.diagnostics.small_views import Shrink
from psfs.sequence import Frame

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
