"""Find keypoints that come late or early: those of one camera against the others', and those of all
cameras against the silhouettes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from apf.keypoints.keypoints import Keypoints
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.triangulation import TriangulationConfig
from psfs.common.numbers import FALSE_ALARMS
from psfs.diagnostics.small_views import SmallViews
from psfs.footage.camera_times import (
    CameraTimes,
    PairCosts,
    compare_signals,
    shift_points,
    sum_costs,
)

#: Greatest lag of a camera from the median one that is found, frames, and the least.
_MOST, _LEAST = 15, 2
#: Reprojection error of a point, as a share of the picture's height, up to which cameras agree, and
#: distance beyond which points and ends are no farther, the same.
AGREEING, _FARTHEST = 0.02, 0.05
_LIMITS = TriangulationConfig()


def find_late_cameras(keypoints: Keypoints, rig: CameraRig) -> dict[str, int]:
    """Return by how many frames the keypoints of cameras come later than the others', by name.

    Every two cameras' keypoints are compared, at every lag, by their distances from epipolar lines.
    Needs three cameras.
    """
    most = min(2 * _MOST, keypoints.n_frames // 3)
    if len(rig) < 3 or most < _LEAST:
        return {}
    points = keypoints.points.astype(np.float64)
    points[np.nan_to_num(points[..., 2]) < _LIMITS.min_confidence] = np.nan
    rays = [
        camera.normalise(view[..., :2].reshape(-1, 2)).reshape(*view.shape[:2], 2)
        for camera, view in zip(rig, points, strict=True)
    ]
    costs = {
        (a, b): sum_costs(_epipolar_distances((rig[a], rig[b]), rays[a], rays[b], most), _FARTHEST)
        for a, b in combinations(range(len(rig)), 2)
    }
    lags = _estimate_lags(len(rig), costs)
    return {name: lag for name, lag in zip(rig.names, lags, strict=True) if lag}


def find_lag_to_footage(keypoints: Keypoints, rig: CameraRig, views: SmallViews) -> int:
    """Return by how many frames the keypoints come later than the silhouettes; 0 if they do not.

    The keypoints' least and greatest x and y in each picture are compared with those of the
    silhouettes' outlines. views: of these cameras or more.
    """
    most = min(2 * _MOST, len(views.frames) // 3)
    if most < _LEAST:
        return 0
    points = keypoints.points[..., :2].astype(np.float64)
    points[np.nan_to_num(keypoints.points[..., 2]) < _LIMITS.min_confidence] = np.nan
    ends = np.fmin.reduce(points, axis=2), np.fmax.reduce(points, axis=2)
    extents = np.concatenate(ends, -1).swapaxes(0, 1)
    outlines = np.full(extents.shape, np.nan)
    frames = np.asarray(views.frames)
    inside = frames < len(extents)
    outlines[frames[inside]] = _outline_extents(views, rig)[inside]
    heights = np.array([camera.size[1] for camera in rig], float)[:, None]
    a, b = ((signal / heights).reshape(len(signal), -1) for signal in (outlines, extents))
    return _estimate_lags(2, {(0, 1): compare_signals(a, b, most, _FARTHEST)})[1]


def _estimate_lags(n_cameras: int, costs: PairCosts) -> list[int]:
    """Return the cameras' lags behind the first, frames; 0 for those that chance explains, or that
    are small. Of more than two cameras, behind the median one."""
    times = CameraTimes(n_cameras, costs)
    offsets = times.offsets - (times.offsets[0] if n_cameras == 2 else 0)
    lags = np.where(times.chances < FALSE_ALARMS, offsets.round().astype(int), 0)
    lags[np.abs(lags) < _LEAST] = 0
    return lags.tolist()


def _epipolar_distances(
    cameras: tuple[Camera, Camera], a: np.ndarray, b: np.ndarray, most: int
) -> np.ndarray:
    """Return the distances (K, 2 most + 1, F), shares of the picture's height, of the second
    camera's points (F, K, 2), at depth 1, from the epipolar lines of the first one's, at all lags.
    """
    first, second = cameras
    R = second.R @ first.R.T
    x, y, z = second.R @ (first.centre - second.centre)
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ R
    lines = np.concatenate([a, np.ones((*a.shape[:2], 1))], -1) @ essential.T
    with np.errstate(divide="ignore", invalid="ignore"):
        lines /= np.linalg.norm(lines[..., :2], axis=-1, keepdims=True)
    padded = np.pad(b, ((most, most), (0, 0), (0, 0)), constant_values=np.nan)
    moved = np.lib.stride_tricks.sliding_window_view(padded, len(a), axis=0)  # (lags, K, 2, F)
    away = np.einsum("fki,lkif->klf", lines[..., :2], moved) + lines[..., 2].T[:, None]
    return away * second.K[0, 0] / second.size[1]


def shift_cameras(keypoints: Keypoints, late: Mapping[str, int]) -> Keypoints:
    """Return the keypoints, those of late cameras shifted back by `late` frames, by name."""
    shifts = [late.get(name, 0) for name in keypoints.camera_names]
    rows = [shift_points(view, lag) for view, lag in zip(keypoints.points, shifts, strict=True)]
    return replace(keypoints, points=np.stack(rows))


def describe_lag(lag: int, rate: float) -> str:
    """Return a lag in words; negative: early."""
    side = "late" if lag > 0 else "early"
    return f"{abs(lag)} frames {side} ({abs(lag) / rate:.2g} s)"


def _outline_extents(views: SmallViews, rig: CameraRig) -> np.ndarray:
    """Return the least x, y and greatest x, y (F, V, 4) of the outlines, px of the large pictures;
    NaN for outlines that the picture's border cuts."""
    columns = [views.rig.names.index(name) for name in rig.names]
    out = np.full((len(views.outlines), len(rig), 4), np.nan)
    for frame, row in enumerate(views.outlines):
        for view, column in enumerate(columns):
            outline = row[column]
            if outline is not None and not outline.at_border.any():
                factor = rig[view].size[0] / views.rig[column].size[0]
                ends = [outline.points.min(axis=0), outline.points.max(axis=0)]
                out[frame, view] = factor * np.concatenate(ends)
    return out
