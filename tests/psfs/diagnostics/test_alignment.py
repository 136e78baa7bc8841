"""Rigs that are a little off are corrected until the silhouettes fit; exact ones stay."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import scenes

from psfs.cameras.camera import CameraRig
from psfs.diagnostics.alignment import RigFit
from psfs.diagnostics.frontier import (
    FrontierPoints,
    epipolar_residuals,
)
from psfs.diagnostics.refinement import correct_camera, measure_scene_motion
from psfs.diagnostics.small_views import Outline, extract_outline, mark_hidden_points

EXACT = scenes.ring(5, (640, 480), 4.0)
OFFSETS = np.array([0.4, -0.3, 0.0, 0.2, -0.3])


def outlines_of(
    rig: CameraRig, n: int = 40, offsets: np.ndarray | None = None
) -> list[list[Outline | None]]:
    """Outlines [frame][view]; camera v takes its pictures offsets[v] frames late."""
    late = np.zeros(len(rig)) if offsets is None else offsets
    return [
        [
            extract_outline(scenes.draw_points(camera, scenes.limbs(frame + own), 9) > 0)
            for camera, own in zip(rig, late, strict=True)
        ]
        for frame in range(n)
    ]


def off(rig: CameraRig, degrees: float) -> CameraRig:
    random = np.random.default_rng(3)
    cameras = []
    for camera in rig:
        turn = random.normal(size=3)
        turn *= np.radians(degrees) / np.linalg.norm(turn)
        K = camera.K.copy()
        K[:2, :2] *= 1 + random.choice([-0.004, 0.004])
        cameras.append(replace(scenes.turned(camera, turn), K=K))
    return CameraRig(tuple(cameras))


@pytest.fixture(scope="module")
def outlines() -> list[list[Outline | None]]:
    return outlines_of(EXACT, 30, OFFSETS)


def test_a_rig_that_is_off_is_corrected_and_its_times_found(
    outlines: list[list[Outline | None]],
) -> None:
    rig = off(EXACT, 0.5)
    found = RigFit(rig, outlines).align(rig)
    assert found is not None and found.is_accepted()
    # What is left is a motion of the whole scene, which silhouettes cannot tell.
    before, after = (scenes.pixels_apart(one, EXACT, scenes.limbs(0)) for one in (rig, found.rig))
    assert after < 0.5 * before
    assert found.after < 0.4 * found.before
    np.testing.assert_allclose(found.corrections.offsets, OFFSETS - OFFSETS.mean(), atol=0.025)
    away = (found.corrections.offsets - OFFSETS + OFFSETS.mean()) / found.corrections.sigmas[:, 7]
    assert np.abs(away).max() < 4
    assert "the calibration is off by" in str(found)


def test_an_exact_rig_stays(outlines: list[list[Outline | None]]) -> None:
    found = RigFit(EXACT, outlines).align(EXACT)
    assert found is not None and not found.is_accepted()
    assert scenes.pixels_apart(found.rig, EXACT, scenes.limbs(0)) < 0.5


def test_nothing_is_said_of_two_cameras_or_of_nobody(
    outlines: list[list[Outline | None]],
) -> None:
    two = EXACT.subset(EXACT.names[:2])
    assert RigFit(two, [row[:2] for row in outlines]).align(two) is None
    assert RigFit(EXACT, [[None] * len(EXACT)] * 40).align(EXACT) is None


def test_residuals_and_their_derivatives() -> None:
    rig = scenes.without_distortion(EXACT)
    random = np.random.default_rng(5)
    points = random.uniform(-0.5, 0.5, (30, 3)) + np.array([0, 0, 1])
    views = np.stack([random.permutation(5)[:2] for _ in points])
    pixels = np.stack(
        [[rig[v].project(p)[0] for v in pair] for p, pair in zip(points, views, strict=True)]
    )
    found = FrontierPoints(views, np.zeros(30, int), pixels, random.normal(0, 0.01, 30))
    residuals, slopes = epipolar_residuals(list(rig), found, np.zeros(5))
    np.testing.assert_allclose(residuals, 0, atol=1e-6)
    for view in range(5):
        for number in range(8):
            values = np.zeros((5, 8))
            values[view, number] = 1e-6
            cameras = [correct_camera(c, own) for c, own in zip(rig, values, strict=True)]
            moved, _ = epipolar_residuals(cameras, found, values[:, 7])
            expected = np.where(views == view, slopes[..., number], 0).sum(1)
            np.testing.assert_allclose(moved / 1e-6, expected, rtol=1e-3, atol=1e-2)


def test_what_silhouettes_cannot_tell_is_held() -> None:
    shifted = np.zeros((len(EXACT), 8))
    shifted[:, 3:6], shifted[:, 7] = [0.1, 0.2, -0.3], 0.25
    held = measure_scene_motion(EXACT) @ shifted.ravel()
    np.testing.assert_allclose(held, [0.1, 0.2, -0.3, 0, 0, 0, 0, 0.25], atol=1e-6)


def test_outlines_end_at_furniture(outlines: list[list[Outline | None]]) -> None:
    hidden = np.zeros((len(EXACT), EXACT.height, EXACT.width), bool)
    whole = outlines[0][0]
    assert whole is not None and not whole.at_border.any()
    x, y = whole.points[0].astype(int)
    hidden[0, y, x] = True
    cut, same = mark_hidden_points(outlines, EXACT.with_hidden(hidden), EXACT)[0][:2]
    assert cut is not None and cut.at_border[0] and not cut.at_border.all()
    assert cut.contour_at_border.any() and not cut.contour_at_border.all()
    other = outlines[0][1]
    assert other is not None and same is not None
    np.testing.assert_array_equal(other.at_border, same.at_border)
