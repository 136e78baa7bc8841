"""Cameras and times from the silhouettes of a walker that is drawn as capsules."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from cl import InputError
from psfs.cameras.camera import Camera, CameraRig
from psfs.diagnostics.refinement import RigCorrections
from psfs.self_calibration import calibrator, checks
from psfs.self_calibration.addition import CameraAddition, choose_core
from psfs.self_calibration.adjustment import (
    Adjusted,
    PersonPoints,
    measure_turn,
    summarise_pairs,
)
from psfs.self_calibration.calibrator import adjust_calibration, calibrate_by_person
from psfs.self_calibration.config import (
    AdjustmentConfig,
    GrowthConfig,
    OutlineConfig,
    PersonConfig,
    UprightConfig,
)
from psfs.self_calibration.footage import outline_person
from psfs.self_calibration.passes import settle
from psfs.self_calibration.take import PersonTake
from psfs.self_calibration.upright import fit_upright

RATE, FRAMES, STATURE = 30.0, 100, 1.77
LAGS = (0, 4, -3, 6)
UNSEEN = [np.zeros((0, 2, 2))] * 4  # no edges of a room
CONFIG = PersonConfig(
    stature=STATURE, longest_lag=0.35, candidates=6, angles=24,
    growth=GrowthConfig(
        angles=12, elevations=(0.05, 0.25), tried=6, kept=(4, 3, 2), places=4, grown=1,
    ),
    adjustment=AdjustmentConfig(passes=1, last=2),
)  # fmt: skip


def place(name, azimuth, distance, height):
    """A camera around the origin that looks at the walker's middle."""
    centre = np.array([distance * np.cos(azimuth), distance * np.sin(azimuth), height])
    forward = np.array([0, 0, 0.9]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    K = np.array([[420.0, 0, 239.5], [0, 420, 179.5], [0, 0, 1]])
    return Camera(name, K, np.zeros(5), R, -R @ centre, (480, 360))


CAMERAS = [
    place("a", 0.3, 4.6, 1.2), place("b", 1.7, 4.3, 2.1), place("c", 3.5, 4.8, 1.6),
    place("d", 5.0, 4.4, 2.4),
]  # fmt: skip


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
        [
            outline_person(draw(camera, (frame - lag) / RATE), OutlineConfig())
            for frame in range(FRAMES)
        ]
        for camera, lag in zip(CAMERAS, LAGS, strict=True)
    ]


def uncalibrated():
    return [replace(camera, R=np.eye(3), t=np.zeros(3)) for camera in CAMERAS]


def test_one_camera_tells_its_tilt_and_height():
    """Over a whole round of the walk, as the start of the search: the adjustment does the rest."""
    for camera in CAMERAS:
        own = [
            outline_person(draw(camera, time), OutlineConfig()) for time in np.linspace(0, 12.5, 50)
        ]
        view, *others = fit_upright(camera, own, UprightConfig())
        assert np.degrees(np.arccos(view.axes[2] @ camera.R[:, 2])) < 3
        assert abs(view.height - camera.centre[2] / STATURE) < 0.15
        assert len(others) == 2


def test_cameras_times_floor_and_scale_are_found():
    found = calibrate_by_person(uncalibrated(), outlines(), UNSEEN, RATE, CONFIG)
    np.testing.assert_allclose(found.lags, LAGS, atol=0.03)
    centres, truth = found.rig.centres, np.array([camera.centre for camera in CAMERAS])
    own, true = (np.linalg.norm(c[:, None] - c[None], axis=-1) for c in (centres, truth))
    np.testing.assert_allclose(own, true, rtol=0.015)
    np.testing.assert_allclose(own / own.sum(), true / true.sum(), atol=0.003 / own.size)
    np.testing.assert_allclose(centres[:, 2], truth[:, 2], atol=0.05)
    ups = [own.R.T @ camera.R[:, 2] for own, camera in zip(found.rig, CAMERAS, strict=True)]
    assert np.degrees(np.arccos(np.array(ups)[:, 2])).max() < 0.6
    assert found.residual < 0.3
    assert found.misfits.max() < 0.5


def test_the_rig_is_grown_camera_by_camera_if_no_arrangement_fits(monkeypatch):
    """The search tells the lags to a frame, but exchanges two cameras."""
    wrong = CameraRig((CAMERAS[0], CAMERAS[2], CAMERAS[1], CAMERAS[3]))
    start = [(wrong, np.array(LAGS) + np.array([0.0, 1, -1, 1]))]
    monkeypatch.setattr(calibrator, "_search", lambda *_: start)
    few = CONFIG.replace(growth=CONFIG.growth.replace(tried=4, kept=(3, 2, 1)))
    found = calibrate_by_person(uncalibrated(), [own[:80] for own in outlines()], UNSEEN, RATE, few)
    np.testing.assert_allclose(found.lags, LAGS, atol=0.05)
    for camera, true in zip(found.rig, CAMERAS, strict=True):
        turn = camera.R @ found.rig[0].R.T @ CAMERAS[0].R @ true.R.T
        assert np.degrees(np.linalg.norm(cv2.Rodrigues(turn)[0])) < 1


def test_a_further_camera_is_placed_beside_a_rig_that_is_found():
    """Of the first three cameras the rig is known, of the last one only the lens."""
    take = PersonTake.create(uncalibrated(), outlines(), UNSEEN, RATE, CONFIG)
    found = Adjusted(CameraRig(tuple(CAMERAS[:3])), np.array(LAGS[:3], float), None)
    addition = CameraAddition(found, [0, 1, 2], take, CONFIG)
    camera, lag = addition.add(3)
    assert abs(lag - LAGS[3]) < 0.05
    turn = camera.R @ addition.rig[0].R.T @ CAMERAS[0].R @ CAMERAS[3].R.T
    assert np.degrees(np.linalg.norm(cv2.Rodrigues(turn)[0])) < 0.5
    apart = np.linalg.norm(camera.centre - addition.rig[0].centre)
    assert abs(apart - np.linalg.norm(CAMERAS[3].centre - CAMERAS[0].centre)) < 0.15


def test_somebody_on_a_circle_is_refused():
    """A second later the walker is where it would be seen from half a radian around the circle."""
    turn = np.array([[np.cos(0.5), -np.sin(0.5), 0], [np.sin(0.5), np.cos(0.5), 0], [0, 0, 1]])
    middle, own = np.array([-1.0, 1.0, 0]), CAMERAS[1]
    R = own.R @ turn.T
    moved = replace(own, R=R, t=-R @ (middle + turn @ (own.centre - middle)))
    rigs = CAMERAS, [CAMERAS[0], moved, *CAMERAS[2:]]
    lags = np.add(LAGS, [[0, 0, 0, 0], [0, -30, 0, 0]]).astype(float)
    ranked = [
        (0.1, Adjusted(CameraRig(tuple(rig)), own, None))
        for rig, own in zip(rigs, lags, strict=True)
    ]
    points = PersonPoints(CAMERAS, outlines(), CONFIG.adjustment)
    rival = checks.find_rival(ranked[0][1], ranked, points, 6, CONFIG)
    with pytest.raises(InputError, match=r"two arrangements .* up to 30 frames, .* by 29 degrees"):
        checks.check_unambiguous(ranked[0][1], rival, points, 6, CONFIG)
    ranked[1] = (0.15, ranked[1][1])
    assert checks.find_rival(ranked[0][1], ranked, points, 6, CONFIG) is None


def test_another_place_of_one_camera_is_compared_by_that_camera(monkeypatch):
    """The worst camera of both arrangements, the last one, stands the same in both."""
    rig = CameraRig(tuple(CAMERAS))
    best, rival = (Adjusted(rig, np.array([0.0, 0, late, 0]), None) for late in (0, 60))
    misfits = {0: [0.3, 0.3, 0.3, 0.7], 60: [0.3, 0.4, 0.6, 0.65]}
    monkeypatch.setattr(checks, "adjust_frontier", lambda *_: rival)
    monkeypatch.setattr(checks, "measure_pairs", lambda of, _: misfits[int(of.lags[2])])
    monkeypatch.setattr(checks, "summarise_pairs", np.array)
    ranked = [(0.1, best), (0.11, rival)]
    assert checks.find_rival(best, ranked, None, 6, CONFIG) is None
    misfits[60][2] = 0.4
    assert checks.find_rival(best, ranked, None, 6, CONFIG) is rival
    with pytest.raises(InputError, match=r"to 0\.70 and 0\.65 px: times differ by up to 60 frames"):
        checks.check_unambiguous(best, rival, None, 6, CONFIG)
    misfits[60][2] = 0.6  # after the last passes
    checks.check_unambiguous(best, rival, None, 6, CONFIG)
    # Adjusted, it becomes the best one.
    monkeypatch.setattr(checks, "adjust_frontier", lambda *_: best)
    assert checks.find_rival(best, ranked, None, 6, CONFIG) is None


def test_one_pair_of_cameras_may_differ_if_both_fit_all_others():
    pairs = np.full((4, 4), 0.4)
    pairs[1, 3] = pairs[3, 1] = 3.8
    assert np.nanmax(checks.exclude_lone_pairs(pairs, CONFIG)) == 0.4
    for worse in (0.8, np.nan):
        pairs[1, 2] = pairs[2, 1] = worse
        assert np.nanmax(checks.exclude_lone_pairs(pairs, CONFIG)) == 3.8


def test_of_grown_rigs_the_one_whose_worst_camera_fits_best_is_taken(monkeypatch):
    """Though more points agree by another."""
    rig, lags = CameraRig(tuple(CAMERAS)), np.array(LAGS, float)
    right, wrong = (
        Adjusted(rig, lags, RigCorrections(np.zeros((4, 8)), np.zeros((4, 8)), 0.2, count))
        for count in (2803, 2888)
    )
    monkeypatch.setattr(calibrator, "adjust_frontier", lambda *_: wrong)
    monkeypatch.setattr(calibrator, "adjust_farther", lambda own, _: own)
    misfits = {2803: [0.4, 0.3, 0.4, 0.4], 2888: [0.3, 0.6, 0.6, 0.3]}
    monkeypatch.setattr(checks, "measure_pairs", lambda own, _: misfits[own.last.count])
    monkeypatch.setattr(checks, "summarise_pairs", np.array)
    grown = [(rig, lags)]
    assert calibrator.adjust_grown(right, grown, None, lambda of, *_: of) is right
    misfits[2888] = [np.nan, 0.1, 0.1, np.nan]  # cameras that share nothing
    assert calibrator.adjust_grown(right, grown, None, lambda of, *_: of) is right
    misfits[2888] = [0.3, 0.3, 0.2, 0.3]
    assert calibrator.adjust_grown(right, grown, None, lambda of, *_: of) is wrong


def test_a_direction_that_is_badly_known_is_refused():
    sigmas = np.full((4, 8), 0.002)
    found = Adjusted(
        CameraRig(tuple(CAMERAS)), np.array(LAGS, float), RigCorrections(sigmas, sigmas, 0.2, 900)
    )
    checks.check_directions(found, CONFIG)
    sigmas[2, :3] = 0.007
    said = rf"{CAMERAS[2].name} .* 0\.69 degrees, .* 0\.25 .* late: .* {CAMERAS[1].name} \+4\.00,"
    with pytest.raises(InputError, match=said):
        checks.check_directions(found, CONFIG)


def test_a_rig_is_adjusted_until_it_stays():
    """One camera is turned by a degree."""
    config = CONFIG.adjustment.replace(last=1)
    points = PersonPoints(CAMERAS, [own[:50] for own in outlines()], config)
    turned = replace(CAMERAS[1], R=cv2.Rodrigues(np.array([0, 0.0175, 0]))[0] @ CAMERAS[1].R)
    turned = replace(turned, t=-turned.R @ CAMERAS[1].centre)
    found = Adjusted(CameraRig((CAMERAS[0], turned, *CAMERAS[2:])), np.array(LAGS, float), None)
    once = settle(found, points)
    points.config = config.replace(last=8)
    last = settle(found, points)
    before, first, settled = (measure_turn(own.rig.cameras, CAMERAS) for own in (found, once, last))
    assert first < 0.4 * before
    assert settled < 0.85 * first
    again = settle(last, points)
    assert measure_turn(again.rig.cameras, last.rig.cameras) < 2 * config.settled


def test_a_given_start_is_adjusted_in_its_own_world():
    """Cameras turned by two degrees and lags half a frame off; nobody searches. Corners of the room
    tell up."""
    rng, start = np.random.default_rng(5), []
    for camera in CAMERAS:
        turn = cv2.Rodrigues(rng.normal(0, np.radians(1.2), 3))[0]
        R = turn @ camera.R
        start.append(replace(camera, R=R, t=-R @ (camera.centre + rng.normal(0, 0.03, 3))))
    lags = np.add(LAGS, [0, 0.5, -0.5, 0.4])
    quick = CONFIG.replace(adjustment=CONFIG.adjustment.replace(first=2, second=3))
    places = rng.uniform(-1, 1, (12, 2))
    corners = np.stack([np.column_stack([places, np.full(12, z)]) for z in (0.2, 2)], axis=1)
    edges = [camera.project(corners)[0] for camera in CAMERAS]
    found = adjust_calibration(CameraRig(tuple(start)), lags, outlines(), edges, RATE, quick)
    turns = [a.R.T @ b.R for a, b in zip(found.rig, CAMERAS, strict=True)]
    assert found.levelled and np.mean(turns, axis=0)[2, 2] > np.cos(np.radians(0.6))
    np.testing.assert_allclose(found.lags, LAGS, atol=0.04)
    own, true = (np.array([c.centre for c in rig]) for rig in (found.rig, CAMERAS))
    np.testing.assert_allclose(own, true, atol=0.25)  # the world is the start's
    own, true = (np.linalg.norm(of[:, None] - of[None], axis=-1) for of in (own, true))
    np.testing.assert_allclose(own / own.sum(), true / true.sum(), atol=0.003 / own.size)


def test_the_cameras_that_see_most_are_searched_first():
    own = [outlines()[0][:50], *outlines()[1:3], outlines()[3][:50]]
    assert choose_core(own, 2) == [1, 2]
    assert choose_core(own, 8) == [0, 1, 2, 3]


def test_a_person_seldom_seen_is_refused_with_what_to_film():
    few = [own[:30] for own in outlines()]
    with pytest.raises(InputError, match=r"a: the whole person is in 30 of 30.*film one person"):
        calibrate_by_person(uncalibrated(), few, UNSEEN, RATE, CONFIG)


def test_two_cameras_are_refused():
    with pytest.raises(InputError, match="2 cameras; expected three or more"):
        calibrate_by_person(uncalibrated()[:2], [[], []], UNSEEN[:2], RATE, CONFIG)


def test_unrelated_films_are_refused():
    """Of one camera of three the film runs backwards."""
    own = [*outlines()[:2], outlines()[3][::-1]]
    cameras = [*uncalibrated()[:2], uncalibrated()[3]]
    growth = CONFIG.growth.replace(tried=2, kept=(2, 1), places=2)
    with pytest.raises(InputError, match=r"those of d and .* film one person"):
        calibrate_by_person(
            cameras, own, UNSEEN[:3], RATE, CONFIG.replace(candidates=3, growth=growth)
        )


def test_a_camera_that_shares_nothing_is_refused(monkeypatch):
    start = [(CameraRig(tuple(CAMERAS)), np.array(LAGS, float))]
    monkeypatch.setattr(calibrator, "_search", lambda *_: start)
    own = [*outlines()[:3], [None] * 60 + outlines()[3][:40]]
    own[:3] = [[*of[:55], *[None] * 45] for of in own[:3]]
    few = CONFIG.replace(growth=CONFIG.growth.replace(tried=2, kept=(2, 1), places=2))
    with pytest.raises(InputError, match=r"d shares too few .*film one person"):
        calibrate_by_person(uncalibrated(), own, UNSEEN, RATE, few)


def test_one_who_stands_still_is_refused():
    still = [[own[50]] * 60 for own in outlines()]
    with pytest.raises(InputError, match=r"hardly moves: .* by 0.0 % .* expected 3 % .*film one"):
        calibrate_by_person(uncalibrated(), still, UNSEEN, RATE, CONFIG)


def test_a_camera_differs_by_the_median_of_its_pairs():
    """Two of four cameras see a shadow alike; of three, two stand opposite to each other."""
    pairs = np.full((4, 4), 0.4)
    pairs[0, 1] = pairs[1, 0] = 2.4
    np.fill_diagonal(pairs, np.nan)
    np.testing.assert_allclose(summarise_pairs(pairs), 0.4)
    pairs[1, 2] = pairs[2, 1] = np.nan
    np.testing.assert_array_equal(summarise_pairs(pairs[:3, :3]), [1.4, np.inf, np.inf])
