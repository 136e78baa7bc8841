"""Cameras and times from the silhouettes of a walker that is drawn as capsules."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from helpers import scenes
from helpers.calibration import moved, unplaced

from cl import InputError
from psfs.cameras.camera import CameraRig
from psfs.self_calibration import calibrator
from psfs.self_calibration.adjustment import (
    Adjusted,
    PersonPoints,
)
from psfs.self_calibration.calibrator import adjust_calibration, calibrate_by_person
from psfs.self_calibration.checks import (
    check_fit,
    check_unambiguous,
    check_uncertainty,
    measure_uncertainty,
)
from psfs.self_calibration.config import PersonConfig
from psfs.self_calibration.footage import outline_person

RATE, FRAMES, STATURE = 30.0, 100, 1.77
LAGS = (0, 4, -3, 6)
UNSEEN = [np.zeros((0, 2, 2))] * 4  # no edges of a room
CONFIG = PersonConfig(stature=STATURE, longest_lag=0.35)


PLACES = [(0.3, 4.6, 1.2), (1.7, 4.3, 2.1), (3.5, 4.8, 1.6), (5.0, 4.4, 2.4)]
CAMERAS = scenes.pinholes(PLACES, [0, 0, 0.9], (480, 360), 420.0)


def capsules(time):
    """Ends (K, 2, 3), m, and radii (K,) of the walker's parts at a time, s."""
    heading = 0.5 * time
    ahead = np.array([np.cos(heading), np.sin(heading), 0])
    aside = np.array([-ahead[1], ahead[0], 0])
    phase = 2 * np.pi * time
    hips = np.array([1.6 * np.sin(0.5 * time) - 1.0, 1.0 - 1.6 * np.cos(0.5 * time), 0.92])
    hips[2] += 0.02 * np.cos(2 * phase)
    up = np.array([0, 0, 1.0])
    neck = hips + 0.55 * up
    parts = [(hips, neck, 0.14), (neck + 0.15 * up, neck + 0.2 * up, 0.1)]
    for side in (1, -1):
        swing = side * np.sin(phase)
        foot = hips + 0.1 * side * aside + 0.3 * swing * ahead
        foot[2] = 0.06 + max(0.0, 0.1 * side * np.cos(phase))
        hand = neck + 0.22 * side * aside - 0.25 * swing * ahead - 0.6 * up
        parts += [(hips + 0.08 * side * aside, foot, 0.07), (foot, foot + 0.15 * ahead, 0.05)]
        parts.append((neck + 0.18 * side * aside, hand, 0.05))
    ends = np.array([(a, b) for a, b, _ in parts])
    return ends, np.array([radius for *_, radius in parts])


def draw(camera, time):
    """The silhouette (h, w) bool: discs along every capsule."""
    ends, radii = capsules(time)
    shares = np.linspace(0, 1, 25)[:, None, None]
    points = ends[:, 0] + shares * (ends[:, 1] - ends[:, 0])
    pixels, depth = camera.project(points.reshape(-1, 3))
    sizes = camera.K[0, 0] * np.tile(radii, len(points)) / depth
    mask = np.zeros(camera.size[::-1], np.uint8)
    for (x, y), size in zip(np.rint(16 * pixels).astype(int), sizes, strict=True):
        cv2.circle(mask, (x, y), round(16 * size), 1, cv2.FILLED, cv2.LINE_8, 4)
    return mask > 0


@cache
def outlines():
    return [
        [outline_person(draw(camera, (frame - lag) / RATE)) for frame in range(FRAMES)]
        for camera, lag in zip(CAMERAS, LAGS, strict=True)
    ]


def test_cameras_times_floor_and_scale_are_found(monkeypatch):
    """As in a large rig, arrangements are compared by some of the cameras: of these pictures they
    find the last one half a stride late."""
    monkeypatch.setattr(calibrator, "CORE", 3)
    found = calibrate_by_person(unplaced(CAMERAS), outlines(), UNSEEN, RATE, CONFIG)
    np.testing.assert_allclose(found.lags, LAGS, atol=0.03)
    centres, truth = found.rig.centres, np.array([camera.centre for camera in CAMERAS])
    own, true = (np.linalg.norm(c[:, None] - c[None], axis=-1) for c in (centres, truth))
    np.testing.assert_allclose(own, true, rtol=0.015)
    np.testing.assert_allclose(own / own.sum(), true / true.sum(), atol=0.003 / own.size)
    np.testing.assert_allclose(centres[:, 2], truth[:, 2], atol=0.07)
    ups = [own.R.T @ camera.R[:, 2] for own, camera in zip(found.rig, CAMERAS, strict=True)]
    assert np.degrees(np.arccos(np.array(ups)[:, 2])).max() < 0.6
    assert found.residual < 0.3
    assert found.misfits.max() < 0.5


def test_a_given_start_is_adjusted_in_its_own_world():
    """Cameras turned by two degrees and lags half a frame off; nobody searches. Corners of the room
    tell up."""
    rng, start = np.random.default_rng(5), []
    for camera in CAMERAS:
        turned = scenes.turned(camera, rng.normal(0, np.radians(1.2), 3))
        start.append(moved(turned, rng.normal(0, 0.03, 3)))
    lags = np.add(LAGS, [0, 0.5, -0.5, 0.4])
    places = rng.uniform(-1, 1, (12, 2))
    corners = np.stack([np.column_stack([places, np.full(12, z)]) for z in (0.2, 2)], axis=1)
    edges = [camera.project(corners)[0] for camera in CAMERAS]
    films = [own[:45] for own in outlines()]
    found = adjust_calibration(CameraRig(tuple(start)), lags, films, edges, RATE, CONFIG)
    turns = [a.R.T @ b.R for a, b in zip(found.rig, CAMERAS, strict=True)]
    assert found.levelled and np.mean(turns, axis=0)[2, 2] > np.cos(np.radians(0.6))
    np.testing.assert_allclose(found.lags, LAGS, atol=0.04)
    own, true = (np.array([c.centre for c in rig]) for rig in (found.rig, CAMERAS))
    np.testing.assert_allclose(own, true, atol=0.25)  # the world is the start's
    own, true = (np.linalg.norm(of[:, None] - of[None], axis=-1) for of in (own, true))
    np.testing.assert_allclose(own / own.sum(), true / true.sum(), atol=0.003 / own.size)


@pytest.mark.parametrize(
    ("views", "change", "said"),
    [
        (4, lambda own: own[:15], r"c0: the whole person is in 15 of 15.*film one person"),
        (2, lambda own: own, "2 cameras; expected three or more"),
        (3, lambda own: own[20:60], "no arrangement of .* fits the silhouettes; film one person"),
        (3, lambda own: [own[50]] * 30, r"hardly moves: .* by 0.0 % .* expected 3 % .*film one"),
    ],
    ids=["seldom seen", "two cameras", "unrelated films", "stands still"],
)
def test_films_that_tell_no_cameras_are_refused(views, change, said):
    """The last of them runs backwards."""
    films = [change(own) for own in outlines()[:views]]
    films[-1] = films[-1][::-1]
    quick = CONFIG.replace(longest_lag=0.1)
    with pytest.raises(InputError, match=said):
        calibrate_by_person(unplaced(CAMERAS)[:views], films, UNSEEN[:views], RATE, quick)


def test_a_film_of_something_else_is_named():
    """The last camera's runs backwards."""
    films = [*outlines()[:3], outlines()[3][::-1]]
    adjusted = Adjusted(CameraRig(tuple(CAMERAS)), np.array(LAGS, float), None)
    check_fit(adjusted, PersonPoints(CAMERAS, outlines(), CONFIG))
    with pytest.raises(InputError, match=r"fit no arrangement .* those of c3 and the other .* px,"):
        check_fit(adjusted, PersonPoints(CAMERAS, films, CONFIG))


def test_somebody_on_a_circle_is_refused():
    """A second later the walker is where it would be seen from half a radian around the circle."""
    turn = np.array([[np.cos(0.5), -np.sin(0.5), 0], [np.sin(0.5), np.cos(0.5), 0], [0, 0, 1]])
    middle, own = np.array([-1.0, 1.0, 0]), CAMERAS[1]
    R = own.R @ turn.T
    moved = replace(own, R=R, t=-R @ (middle + turn @ (own.centre - middle)))
    best = Adjusted(CameraRig(tuple(CAMERAS)), np.array(LAGS, float), None)
    rig = CameraRig((CAMERAS[0], moved, *CAMERAS[2:]))
    rival = Adjusted(rig, np.add(LAGS, [0, -30, 0, 0]), None)
    points = PersonPoints(CAMERAS, outlines(), CONFIG)
    with pytest.raises(InputError, match=r"two arrangements .* up to 30 frames, .* by 29 degrees"):
        check_unambiguous(best, rival, points, RATE)
    exchanged = CameraRig((CAMERAS[1], CAMERAS[0], *CAMERAS[2:]))
    check_unambiguous(best, Adjusted(exchanged, best.lags, None), points, RATE)


def test_what_is_badly_known_is_refused():
    """The walker is known well; directions that are not are named with the times."""
    found = Adjusted(CameraRig(tuple(CAMERAS)), np.array(LAGS, float), None)
    points = PersonPoints(CAMERAS, outlines(), CONFIG)
    turns, shifts = measure_uncertainty(found, points, RATE)
    assert np.degrees(turns).max() < 0.25 and shifts.max() < 0.0075
    check_uncertainty(found, turns, shifts, points)
    turns[2] = 0.014
    said = rf"{CAMERAS[2].name}'s direction .*0\.80 degrees, .* 0\.50\).* late: .*c1 \+4\.00,"
    with pytest.raises(InputError, match=said):
        check_uncertainty(found, turns, shifts, points)
