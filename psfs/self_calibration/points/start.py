"""Place cameras by keypoints: two by their essential matrix, each further one by what these see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np

from psfs.cameras.camera import Camera
from psfs.diagnostics.refinement import N_PARAMETERS
from psfs.self_calibration.points.bundle import (
    PointObservations,
    PointScene,
    adjust_points,
    measure_errors,
    triangulate_rays,
)

#: RANSAC's confidence; its most trials; its gate in standard deviations of a keypoint.
_SURE, _TRIALS, GATE = 0.9999, 2000, 3.0
#: Fewest keypoints that two neighbouring cameras must share.
FEWEST = 60
#: Least median angle between the rays of the two cameras that are placed first, degrees; pairs of
#: cameras from which a start is tried.
_PARALLAX, _STARTS = 4.0, 4


def place_cameras(
    cameras: Sequence[Camera], observations: PointObservations, noise: float
) -> list[PointScene]:
    """Return the scenes from each of the best first pairs of cameras, those that place all.

    noise: standard deviation of a keypoint, px.
    """
    pairs = []
    for pair in combinations(range(len(cameras)), 2):
        found = _place_pair(cameras, observations, pair, noise)
        if found is not None:
            pairs.append((found[0], pair, found[1]))
    pairs.sort(key=lambda of: -of[0])
    scenes = [_place_others(scene, observations, pair, noise) for _, pair, scene in pairs[:_STARTS]]
    return [scene for scene in scenes if scene is not None]


def _place_pair(
    cameras: Sequence[Camera], observations: PointObservations, pair: tuple[int, int], noise: float
) -> tuple[float, PointScene] | None:  # fmt: skip
    """Return how well two cameras determine each other, and them with their points; None if they
    do not. The first is the world's origin, and 1 the distance to the second."""
    seen = observations.seen
    both = np.flatnonzero(seen[pair[0]] & seen[pair[1]])
    if len(both) < FEWEST:
        return None
    first, second = (cameras[v].normalise(observations.pixels[v, both]) for v in pair)
    gate = GATE * noise / np.mean([cameras[view].K[0, 0] for view in pair])
    cv2.setRNGSeed(1)
    E, inside = cv2.findEssentialMat(
        first, second, np.eye(3), method=cv2.RANSAC, prob=_SURE, threshold=gate, maxIters=_TRIALS
    )
    if E is None or E.shape != (3, 3):
        return None
    count, R, t, ahead, _ = cv2.recoverPose(
        E, first, second, np.eye(3), distanceThresh=1e3, mask=inside.copy()
    )
    if count < FEWEST:
        return None
    placed = list(cameras)
    placed[pair[0]] = replace(cameras[pair[0]], R=np.eye(3), t=np.zeros(3))
    placed[pair[1]] = replace(cameras[pair[1]], R=R, t=t.ravel())
    own = [placed[view] for view in pair]
    points = triangulate_rays(own, observations.pixels[list(pair)])
    good = both[ahead.ravel() > 0]
    rays = [points[good] - camera.centre for camera in own]
    rays = [of / np.linalg.norm(of, axis=1, keepdims=True) for of in rays]
    parallax = np.degrees(np.arccos(np.clip((rays[0] * rays[1]).sum(axis=1), -1, 1)))
    wide = float(np.median(np.minimum(parallax, 180 - parallax)))
    if wide < _PARALLAX:
        return None
    scene = PointScene(tuple(placed), np.zeros(len(cameras)), points)
    return count * np.sqrt(np.sin(np.radians(wide))), scene


def _place_others(
    scene: PointScene, observations: PointObservations, pair: tuple[int, int], noise: float
) -> PointScene | None:  # fmt: skip
    """Return the scene with all cameras, the one that sees most of its points next; None if one
    cannot be placed."""
    placed = sorted(pair)
    scene = _adjust_some(scene, observations, placed, noise)
    while len(placed) < len(scene.cameras):
        known = np.isfinite(scene.points).all(axis=-1)
        shared = (observations.seen & known).sum(axis=1)
        shared[placed] = -1
        view = int(shared.argmax())
        camera = _resect(scene, observations, view, noise)
        if camera is None:
            return None
        cameras = (*scene.cameras[:view], camera, *scene.cameras[view + 1 :])
        placed = sorted([*placed, view])
        scene = PointScene(cameras, scene.lags, scene.points)
        scene = _adjust_some(scene, observations, placed, noise)
    return scene


def _resect(
    scene: PointScene, observations: PointObservations, view: int, noise: float
) -> Camera | None:  # fmt: skip
    """Return a camera placed by known points; None if it sees too few of them."""
    camera = scene.cameras[view]
    both = np.flatnonzero(observations.seen[view] & np.isfinite(scene.points).all(axis=-1))
    if len(both) < FEWEST:
        return None
    flat = camera.normalise(observations.pixels[view, both])
    cv2.setRNGSeed(1)
    found, turn, shift, inside = cv2.solvePnPRansac(
        scene.points[both], flat, np.eye(3), None, iterationsCount=_TRIALS, confidence=_SURE,
        reprojectionError=2 * GATE * noise / camera.K[0, 0], flags=cv2.SOLVEPNP_EPNP,
    )  # fmt: skip
    if not found or inside is None or len(inside) < FEWEST // 2:
        return None
    return replace(camera, R=cv2.Rodrigues(turn)[0], t=shift.ravel())


def _adjust_some(
    scene: PointScene, observations: PointObservations, placed: list[int], noise: float
) -> PointScene:  # fmt: skip
    """Triangulate all points by the placed cameras and adjust these, lags and lenses kept."""
    some = observations.select(placed)
    cameras = tuple(scene.cameras[view] for view in placed)
    points = triangulate_rays(cameras, some.pixels)
    sigmas = pose_sigmas(len(placed))
    own = PointScene(cameras, np.zeros(len(placed)), points)
    own = adjust_points(own, some, sigmas, noise)
    # Points that fit badly are not used to place the next camera.
    worst = np.nan_to_num(measure_errors(own, some)).max(axis=0)
    points = np.where((worst < 4 * GATE * noise)[:, None], own.points, np.nan)
    merged = list(scene.cameras)
    for view, camera in zip(placed, own.cameras, strict=True):
        merged[view] = camera
    return PointScene(tuple(merged), scene.lags, points)


def pose_sigmas(n_cameras: int) -> np.ndarray:
    """Return standard deviations (V, 8) that leave all poses free but the first's, and keep lenses
    and lags."""
    sigmas = np.zeros((n_cameras, N_PARAMETERS))
    sigmas[1:, :6] = 1e3
    return sigmas
