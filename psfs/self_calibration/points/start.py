"""Start from keypoints: the lags of all cameras, two cameras by their essential matrix, and each
further one by what these see.

Two cameras see points of one time along epipolar lines, which the linear eight-point algorithm
finds at the right lag only (Hartley, PAMI 19, 1997).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np

from psfs.cameras.camera import Camera
from psfs.cameras.triangulation import triangulate_rays
from psfs.common.numbers import pick_evenly
from psfs.diagnostics.refinement import N_PARAMETERS
from psfs.footage.camera_times import LEAST_OVERLAP, CameraTimes, shift_points, sum_costs
from psfs.self_calibration.points.bundle import (
    PointObservations,
    PointScene,
    adjust_points,
    measure_errors,
)

#: RANSAC's confidence; its most trials; its gate in standard deviations of a keypoint.
_SURE, _TRIALS, GATE = 0.9999, 2000, 3.0
#: Fewest keypoints that two neighbouring cameras must share.
FEWEST = 60
#: Least median angle between the rays of the two cameras that are placed first, degrees.
_PARALLAX = 4.0


def place_cameras(
    cameras: Sequence[Camera], observations: PointObservations, noise: float
) -> PointScene | None:
    """Return the scene from the best first pair of cameras from which all can be placed; None if
    there is none.

    noise: standard deviation of a keypoint, px.
    """
    pairs = []
    for pair in combinations(range(len(cameras)), 2):
        placed = _place_pair(cameras, observations, pair, noise)
        if placed is not None:
            pairs.append((placed[0], pair, placed[1]))
    pairs.sort(key=lambda of: -of[0])
    scenes = (_place_others(scene, observations, pair, noise) for _, pair, scene in pairs)
    return next((scene for scene in scenes if scene is not None), None)


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
    both_cameras = [placed[view] for view in pair]
    points = triangulate_rays(both_cameras, observations.pixels[list(pair)])
    good = both[ahead.ravel() > 0]
    rays = [points[good] - camera.centre for camera in both_cameras]
    rays = [directions / np.linalg.norm(directions, axis=1, keepdims=True) for directions in rays]
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
    solved, turn, shift, inside = cv2.solvePnPRansac(
        scene.points[both], flat, np.eye(3), None, iterationsCount=_TRIALS, confidence=_SURE,
        reprojectionError=2 * GATE * noise / camera.K[0, 0], flags=cv2.SOLVEPNP_EPNP,
    )  # fmt: skip
    if not solved or inside is None or len(inside) < FEWEST // 2:
        return None
    return replace(camera, R=cv2.Rodrigues(turn)[0], t=shift.ravel())


def _adjust_some(
    scene: PointScene, observations: PointObservations, placed: list[int], noise: float
) -> PointScene:  # fmt: skip
    """Triangulate all points by the placed cameras and adjust these, lags and lenses kept."""
    selected = observations.select(placed)
    cameras = tuple(scene.cameras[view] for view in placed)
    points = triangulate_rays(cameras, selected.pixels)
    sigmas = pose_sigmas(len(placed))
    placed_scene = PointScene(cameras, np.zeros(len(placed)), points)
    placed_scene = adjust_points(placed_scene, selected, sigmas, noise)
    # Points that fit badly are not used to place the next camera.
    worst = np.nan_to_num(measure_errors(placed_scene, selected)).max(axis=0)
    points = np.where((worst < 4 * GATE * noise)[:, None], placed_scene.points, np.nan)
    merged = list(scene.cameras)
    for view, camera in zip(placed, placed_scene.cameras, strict=True):
        merged[view] = camera
    return PointScene(tuple(merged), scene.lags, points)


def pose_sigmas(n_cameras: int) -> np.ndarray:
    """Return standard deviations (V, 8) that leave all poses free but the first's, and keep lenses
    and lags."""
    sigmas = np.zeros((n_cameras, N_PARAMETERS))
    sigmas[1:, :6] = 1e3
    return sigmas


#: Rounds of the robust weights of the eight-point algorithm, and their width in medians.
_ROUNDS, _WIDTH = 4, 2.0
#: Most points of two cameras that are compared at each lag, and distance beyond which they are no
#: farther, in standard deviations.
_COMPARED, _FARTHEST = 600, 10.0


def measure_epipolar(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the distances (N,) of points (N, 2) of two cameras from the epipolar lines of the
    fundamental matrix that fits them best (Sampson's distance), in the points' unit."""
    points, scales = [], []
    for pixels in (a, b):
        middle, spread = pixels.mean(axis=0), pixels.std() + 1e-12
        points.append(np.column_stack([(pixels - middle) / spread, np.ones(len(pixels))]))
        scales.append(spread)
    rows = (points[1][:, :, None] * points[0][:, None]).reshape(-1, 9)
    weights, away = np.ones(len(rows)), np.zeros(len(rows))
    for _ in range(_ROUNDS):
        normal = (rows * weights[:, None] ** 2).T @ rows
        U, sizes, Vt = np.linalg.svd(np.linalg.eigh(normal)[1][:, 0].reshape(3, 3))
        F = U @ np.diag([sizes[0], sizes[1], 0]) @ Vt
        lines, back = points[0] @ F.T, points[1] @ F
        slope = (lines[:, :2] ** 2).sum(1) / scales[1] ** 2 + (back[:, :2] ** 2).sum(1) / scales[
            0
        ] ** 2
        slope = np.sqrt(slope) + 1e-15
        away = np.abs((points[1] * lines).sum(axis=1)) / slope
        weights = 1 / slope / (1 + (away / (_WIDTH * np.median(away) + 1e-12)) ** 2)
    return away


def estimate_lags(seen: np.ndarray, most: int, noise: float) -> np.ndarray:
    """Return the lags (V,) of cameras behind the first, whole frames up to `most`.

    seen: (V, F, K, 2), NaN where a point is not seen. noise: standard deviation of a point, px.
    """
    pairs = combinations(range(len(seen)), 2)
    costs = {(a, b): _compare_lags(seen[a], seen[b], most, noise) for a, b in pairs}
    whole = np.array(CameraTimes(len(seen), costs).whole)
    return whole - whole[0]


def _compare_lags(a: np.ndarray, b: np.ndarray, most: int, noise: float) -> np.ndarray:
    """Return the costs, see `camera_times`, of the distances from epipolar lines at all lags."""
    n_frames, n_points = a.shape[:2]
    distances = np.full((n_points, 2 * most + 1, n_frames), np.nan)
    for row, lag in enumerate(range(-most, most + 1)):
        other = shift_points(b, lag)
        rows = np.flatnonzero((np.isfinite(a) & np.isfinite(other)).all(-1))
        rows = rows[pick_evenly(len(rows), _COMPARED)]
        if len(rows) >= FEWEST and n_frames - abs(lag) >= LEAST_OVERLAP * n_frames:
            away = measure_epipolar(a.reshape(-1, 2)[rows], other.reshape(-1, 2)[rows])
            distances[rows % n_points, row, rows // n_points] = away
    # Two cameras may be `most` apart, on either side of the median camera.
    return np.pad(sum_costs(distances, _FARTHEST * noise), ((most, most), (0, 0), (0, 0)))
