"""Cameras and lags from the keypoints of one person who moves.

Lags from the eight-point algorithm (`lags`); two cameras by their essential matrix and the others
by resection (`start`); bundle adjustment of cameras, lags and points (`bundle`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cl import InputError
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.names import join_names
from psfs.cameras.rig_geometry import transfer_poses
from psfs.cameras.triangulation import triangulate_rays
from psfs.common.numbers import pick_evenly
from psfs.footage.camera_times import shift_points
from psfs.self_calibration.config import PersonConfig
from psfs.self_calibration.points.bundle import (
    PointObservations,
    PointScene,
    adjust_points,
    measure_errors,
)
from psfs.self_calibration.points.start import (
    FEWEST,
    GATE,
    estimate_lags,
    place_cameras,
    pose_sigmas,
)

#: What to film if the cameras cannot be found.
FILM = (
    "expected keypoints of one person who walks about for some seconds, seen by all cameras at once"
)
#: Rounds of fractions of a lag, after each of which whole frames are shifted.
_ROUNDS = 6
#: Most frames that are used, evenly spread.
_MOST_FRAMES = 150
#: Frames to either side between which a keypoint's speed is measured.
_STEPS = (1, 2, 3)


@dataclass(frozen=True, eq=False)
class PointCalibration:
    """Cameras found from keypoints, in axes and a unit of their own.

    rig: the cameras. lags: (V,) frame t of the first camera shows the time of frame t + lags[v] of
    camera v. points: (F, K, 3) of F frames of the first camera; NaN where less than two cameras see
    one. errors: (V,) px, median distance of each camera's keypoints from where the points appear.
    """

    rig: CameraRig
    lags: np.ndarray
    points: np.ndarray
    errors: np.ndarray


def calibrate_by_points(
    cameras: Sequence[Camera], keypoints: np.ndarray, longest_lag: int, config: PersonConfig,
    segments: Sequence[tuple[int, int]] = (),
) -> PointCalibration:  # fmt: skip
    """Estimate the cameras' poses and lags from keypoints (V, F, K, 3): px of the pictures, with
    distortion, and confidence; NaN where missing.

    cameras: with intrinsics; poses are ignored. longest_lag: frames; 0: none comes late. segments:
    pairs of keypoints whose distance stays the same. Raises InputError, which says what to film, if
    the cameras cannot be found.
    """
    if len(cameras) < 2:
        raise InputError(f"{len(cameras)} camera; expected two or more")
    plain = [_without_distortion(camera) for camera in cameras]
    seen = np.stack([_undistort(*pair, config) for pair in zip(cameras, keypoints, strict=True)])
    longest = max(max(camera.size) for camera in cameras)
    noise = config.worst_keypoint / GATE * longest
    lags = np.zeros(len(cameras), int)
    if longest_lag:
        lags = estimate_lags(seen, longest_lag, noise)
    frames = _choose_frames(seen, lags)
    scene = place_cameras(plain, _observe(seen, lags, frames, segments), noise)
    if scene is None:
        raise InputError(f"no arrangement of the cameras fits the keypoints; {FILM}")
    scene, lags = _adjust(scene, seen, lags, frames, segments, noise, config.focal)
    return _finish(cameras, scene, seen, lags, frames, config)


def _without_distortion(camera: Camera) -> Camera:
    """Return the camera with square pixels, the origin at its principal point."""
    focal = camera.K[0, 0]
    K = np.diag([focal, focal, 1.0])
    return Camera(camera.name, K, np.zeros(5), np.eye(3), np.zeros(3), camera.size)


def _undistort(camera: Camera, points: np.ndarray, config: PersonConfig) -> np.ndarray:
    """Return sure keypoints (F, K, 3) as pixels (F, K, 2) of `_without_distortion`."""
    sure = np.isfinite(points).all(axis=-1) & (np.nan_to_num(points[..., 2]) >= config.confidence)
    out = np.full((*points.shape[:2], 2), np.nan)
    out[sure] = camera.K[0, 0] * camera.normalise(points[sure][:, :2])
    return out


def _choose_frames(seen: np.ndarray, lags: np.ndarray) -> np.ndarray:
    """Return the first camera's frames (F,) that are used: of those that two cameras have."""
    is_seen = np.stack(
        [
            np.isfinite(shift_points(view_points, int(lag))).any(axis=(1, 2))
            for view_points, lag in zip(seen, lags, strict=True)
        ]
    )
    common = np.flatnonzero(is_seen.sum(axis=0) > 1)
    return np.asarray(common[pick_evenly(len(common), _MOST_FRAMES)], int)


def _observe(
    seen: np.ndarray, lags: np.ndarray, frames: np.ndarray, pairs: Sequence[tuple[int, int]] = ()
) -> PointObservations:
    """Return the pixels and speeds of all keypoints at the first camera's `frames`; pairs: of
    keypoints, segments between which stay as long."""
    pixels, speeds = [], []
    for view_points, lag in zip(seen, lags, strict=True):
        pixels.append(shift_points(view_points, int(lag))[frames].reshape(-1, 2))
        speeds.append(_measure_speeds(view_points, int(lag))[frames].reshape(-1, 2))
    first = seen.shape[2] * np.arange(len(frames))[:, None, None]
    segments = first + np.reshape(pairs, (-1, 2)).astype(int)
    return PointObservations(np.stack(pixels), np.stack(speeds), segments)


def _measure_speeds(points: np.ndarray, lag: int) -> np.ndarray:
    """Return the speeds (F, K, 2), px per frame, of points shifted by a lag: the median of
    differences over several frames, since noise in speeds would make lags too small; 0 where they
    are unknown."""
    apart = [
        (shift_points(points, lag + step) - shift_points(points, lag - step)) / (2 * step)
        for step in _STEPS
    ]
    known = np.isfinite(np.stack(apart)).any(axis=0)
    filled = np.where(known, apart, 0.0)
    return np.nanmedian(filled, axis=0)


def _adjust(
    scene: PointScene, seen: np.ndarray, lags: np.ndarray, frames: np.ndarray,
    segments: Sequence[tuple[int, int]], noise: float, focal: float,
) -> tuple[PointScene, np.ndarray]:  # fmt: skip
    """Return the adjusted scene, and the lags (V,), whole frames, to which its own are added."""
    sigmas = pose_sigmas(len(scene.cameras))
    sigmas[:, 6] = focal
    sigmas[1:, 7] = 1.0
    for _ in range(_ROUNDS):
        observations = _observe(seen, lags, frames, segments)
        points = triangulate_rays(scene.cameras, observations.pixels)
        scene = replace(scene, points=points)
        for width in (2, 1):  # narrow weights would take what moves for wrong
            scene = adjust_points(scene, observations, sigmas, width * noise)
        whole = np.round(scene.lags).astype(int)
        if not whole.any():
            break
        lags, scene = lags + whole, replace(scene, lags=scene.lags - whole)
    return scene, lags


def _finish(
    cameras: Sequence[Camera], scene: PointScene, seen: np.ndarray, lags: np.ndarray,
    frames: np.ndarray, config: PersonConfig,
) -> PointCalibration:  # fmt: skip
    """Return the calibration. Raises InputError if it cannot be trusted."""
    observations = _observe(seen, lags, frames)
    away = measure_errors(scene, observations)
    enough = np.isfinite(away).sum(axis=1) >= FEWEST
    if not enough.all():
        few = join_names(c.name for c, many in zip(cameras, enough, strict=True) if not many)
        raise InputError(f"{few}: too few keypoints are seen by another camera, too; {FILM}")
    medians = np.nanmedian(away, axis=1)
    shares = medians / np.array([max(camera.size) for camera in cameras])
    worst = int(shares.argmax())
    if shares[worst] > config.worst_keypoint:
        limit = config.worst_keypoint * max(cameras[worst].size)
        raise InputError(
            f"the keypoints fit no arrangement of the cameras: those of {cameras[worst].name} are "
            f"{medians[worst]:.1f} px off, expected at most {limit:.1f}; {FILM}"
        )
    placed = transfer_poses(cameras, cameras, scene.cameras)
    points = scene.points.reshape(len(frames), -1, 3)
    return PointCalibration(placed, lags + scene.lags, points, medians)
