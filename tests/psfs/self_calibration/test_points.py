"""Cameras and lags from points that move about together, as the keypoints of a walker do."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from helpers.calibration import ring, unplaced

from cl import InputError
from psfs.self_calibration.config import PersonConfig
from psfs.self_calibration.points.bundle import (
    PointObservations,
    PointScene,
    adjust_points,
    measure_errors,
)
from psfs.self_calibration.points.calibrator import calibrate_by_points
from psfs.self_calibration.points.start import pose_sigmas

CAMERAS = ring()[:4]
CONFIG = PersonConfig()
FRAMES, LAGS = 70, np.array([0, 4, -3.4, 6.25])
LENS = np.array([-0.1, 0.02, 0.001, -0.001, 0])


def places(times):
    """Points (F, K, 3), m, of somebody who walks a curve with swinging arms and legs."""
    rng = np.random.default_rng(2)
    body = rng.normal(0, [0.15, 0.25, 0.5], (12, 3))
    turn, phase = 0.8 * times[:, None], rng.uniform(0, 6, 12)
    x = body[:, 0] + 0.2 * np.sin(6 * times[:, None] + phase)
    y = body[:, 1] + 0.05 * np.cos(6 * times[:, None] + phase)
    z = 0.9 + body[:, 2] + 0.05 * np.sin(5 * times[:, None] + phase)
    local = np.stack([np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y, z])
    path = np.stack([np.sin(times), 0.6 - np.cos(1.3 * times), 0 * times])[..., None]
    return np.moveaxis(local + path, 0, -1)


@cache
def seen(noise=0.7):
    """Keypoints (V, F, K, 3) of cameras with distortion; one in ten is missing, one in fifty
    wrong."""
    rng, out = np.random.default_rng(3), []
    for camera, lag in zip(CAMERAS, LAGS, strict=True):
        times = (np.arange(FRAMES) - lag) / 30
        pixels, _ = replace(camera, distortion=LENS).project(places(times).reshape(-1, 3))
        pixels = pixels.reshape(FRAMES, 12, 2) + rng.normal(0, noise, (FRAMES, 12, 2))
        pixels[rng.random((FRAMES, 12)) < 0.02] += 40
        pixels[rng.random((FRAMES, 12)) < 0.1] = np.nan
        out.append(np.concatenate([pixels, np.ones((FRAMES, 12, 1))], -1))
    return np.stack(out)


def lenses(factor=1.0):
    cameras = [replace(camera, distortion=LENS) for camera in unplaced(CAMERAS)]
    return [replace(c, K=c.K * [[factor, 1, 1], [1, factor, 1], [1, 1, 1]]) for c in cameras]


def compare(found, truth=CAMERAS):
    """Return the worst error of the distances between cameras, as a share."""
    own, true = (np.array([c.centre for c in rig]) for rig in (found, truth))
    own, true = (np.linalg.norm(of[:, None] - of[None], axis=-1) for of in (own, true))
    return np.abs(own / own.sum() - true / true.sum()).max() / (true / true.sum()).max()


def test_cameras_and_lags_are_found():
    found = calibrate_by_points(lenses(), seen(), 9, CONFIG)
    np.testing.assert_allclose(found.lags, LAGS, atol=0.1)
    assert compare(found.rig) < 0.004
    turns = [b.R.T @ a.R for a, b in zip(found.rig, CAMERAS, strict=True)]  # all the same
    apart = [np.linalg.norm(turn @ turns[0].T - np.eye(3)) / np.sqrt(2) for turn in turns]
    assert np.degrees(max(apart)) < 0.4
    assert found.errors.max() < 1.2 and found.rig[1].distortion[0] == LENS[0]
    assert np.isfinite(found.points).all(axis=-1).mean() > 0.9


def test_focal_lengths_are_found_from_an_angle_of_view():
    found = calibrate_by_points(lenses(1.08), seen(), 7, CONFIG.replace(focal=0.1))
    shares = [own.K[0, 0] / true.K[0, 0] for own, true in zip(found.rig, CAMERAS, strict=True)]
    np.testing.assert_allclose(shares, 1, atol=0.03)
    assert compare(found.rig) < 0.01


@pytest.mark.parametrize("rigid", [False, True])
def test_the_steps_use_the_errors_derivatives(rigid):
    """Four steps from a slightly wrong scene are enough if the derivatives are right."""
    rng = np.random.default_rng(4)
    body = rng.uniform(-0.4, 0.4, (12, 3))
    turns = [cv2.Rodrigues(rng.normal(0, 0.5, 3))[0] for _ in range(5)]
    points = np.concatenate([body @ turn.T for turn in turns]) + np.array([0, 0, 0.9])
    plain = [
        replace(c, K=np.diag([c.K[0, 0], c.K[0, 0], 1]), distortion=np.zeros(5)) for c in CAMERAS
    ]
    pixels = np.stack([camera.project(points)[0] for camera in plain])
    speeds = rng.normal(0, 3, pixels.shape)
    sigmas = pose_sigmas(4)
    sigmas[1:, 6:] = 0.05, 1.0
    lags = np.array([0, 0.3, -0.2, 0.1])
    ends = 12 * np.arange(5)[:, None, None] + [[0, 1], [1, 2], [4, 7]]
    segments = ends if rigid else np.zeros((5, 0, 2), int)
    observations = PointObservations(pixels - lags[:, None, None] * speeds, speeds, segments)
    wrong = [replace(c, K=c.K * (1 + 0.01 * np.diag([1, 1, 0]))) for c in plain[1:]]
    start = PointScene((plain[0], *wrong), np.zeros(4), points + rng.normal(0, 0.01, (60, 3)))
    found = adjust_points(start, observations, sigmas, 1e-3)
    assert measure_errors(found, observations).max() < 1e-3
    np.testing.assert_allclose(found.lags, lags, atol=1e-3)


def test_what_does_not_fit_is_refused():
    with pytest.raises(InputError, match="1 camera; expected two"):
        calibrate_by_points(lenses()[:1], seen()[:1], 0, CONFIG)
    few = seen()[:, :12].copy()
    few[:, 4:] = np.nan
    with pytest.raises(InputError, match=r"no arrangement .* one person who walks about"):
        calibrate_by_points(lenses(), few, 0, CONFIG)
    mixed = seen()[[0, 1, 3], :40].copy()
    mixed[2] = mixed[2, ::-1]
    with pytest.raises(InputError, match=r"fit no arrangement .* of cam04 are \d+\.\d px off"):
        calibrate_by_points([lenses()[view] for view in (0, 1, 3)], mixed, 0, CONFIG)
