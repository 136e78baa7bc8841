"""Find keypoints that come late or early: those of one camera against the others', and those of all
cameras against the silhouettes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from apf.keypoints.keypoints import Keypoints
from psfs.cameras.camera import CameraRig
from psfs.cameras.triangulation import TriangulationConfig, reprojection_errors, triangulate
from psfs.diagnostics.small_views import SmallViews
from psfs.self_calibration.points.lags import shift_points

#: Greatest and least lag that is found, and examined frames.
_MOST, _LEAST, _SAMPLED = 15, 2, 40
#: Reprojection error of a point, as a share of the picture's height, up to which cameras agree.
AGREEING = 0.02
#: Least factor by which distances must fall with the lag: from where the other cameras see points
#: (1.08 at most untouched, 1.5 and more late), and of the silhouettes' ends (1.01, and 1.10).
_CAMERA_GAIN, _FOOTAGE_GAIN = 1.3, 1.07
#: Distance that is noise, and beyond which ends are no farther, as shares of the picture's height.
_NOISE, _FARTHEST = 0.0005, 0.05
_LIMITS = TriangulationConfig()


def find_late_cameras(keypoints: Keypoints, rig: CameraRig) -> dict[str, int]:
    """Return by how many frames the keypoints of cameras come later than the others', by name.

    Each camera's keypoints are compared, at every lag, with the points that the others triangulate.
    In each step the camera that gains most by a shift is shifted. Needs three cameras.
    """
    most = min(_MOST, keypoints.n_frames // 3)
    late: dict[str, int] = {}
    if len(rig) < 3 or most < _LEAST:
        return late
    points = keypoints.undistort(rig).points.astype(np.float64)
    points[np.nan_to_num(points[..., 2]) < _LIMITS.min_confidence] = np.nan
    for _ in range((len(rig) - 1) // 2):
        curves = _camera_costs(points, rig, most)
        gains = _gains(curves, most, _NOISE)
        view = int(gains.argmax())
        lag = int(np.nanargmin(curves[view])) - most if gains[view] > 1 else 0
        if gains[view] < _CAMERA_GAIN or not _LEAST <= abs(lag) < most:
            break
        late[rig.names[view]] = lag
        points[view] = shift_points(points[view], lag)
    return late


def find_lag_to_footage(keypoints: Keypoints, rig: CameraRig, views: SmallViews) -> int:
    """Return by how many frames the keypoints come later than the silhouettes; 0 if they do not.

    The keypoints' least and greatest x and y in each picture are compared with those of the
    silhouettes' outlines; what differs in all frames alike, since keypoints lie within the body, is
    subtracted. views: of these cameras or more.
    """
    most = min(_MOST, len(views.frames) // 3)
    if most < _LEAST:
        return 0
    outlines = _outline_extents(views, rig)
    shown = keypoints.points[..., :2].astype(np.float64)
    shown[np.nan_to_num(keypoints.points[..., 2]) < _LIMITS.min_confidence] = np.nan
    with np.errstate(invalid="ignore"):
        extents = np.concatenate([_least(shown), -_least(-shown)], -1).swapaxes(0, 1)
    heights = np.array([camera.size[1] for camera in rig], float)[:, None]
    cap, costs = _FARTHEST, np.full(2 * most + 1, np.nan)
    for number, lag in enumerate(range(-most, most + 1)):
        rows = np.asarray(views.frames) + lag
        there = (rows >= 0) & (rows < len(extents))
        apart = (extents[rows[there]] - outlines[there]) / heights
        known = np.isfinite(apart).any(axis=0)
        if known.any():
            apart = apart[:, known] - np.nanmedian(apart[:, known], axis=0)
            costs[number] = np.nanmean(np.minimum(np.abs(apart), cap))
    if not np.isfinite(costs[most]):
        return 0
    lag = int(np.nanargmin(costs)) - most
    gain = _gains(costs[None], most, _NOISE)[0]
    return lag if gain >= _FOOTAGE_GAIN and _LEAST <= abs(lag) < most else 0


def shift_cameras(keypoints: Keypoints, late: Mapping[str, int]) -> Keypoints:
    """Return the keypoints, those of late cameras shifted back by `late` frames, by name."""
    shifts = [late.get(name, 0) for name in keypoints.camera_names]
    rows = [shift_points(view, lag) for view, lag in zip(keypoints.points, shifts, strict=True)]
    return replace(keypoints, points=np.stack(rows))


def describe_lags(late: Mapping[str, int], rate: float) -> list[str]:
    """Return a line for each camera whose keypoints are late; rate: frames per second."""
    return [
        f"the keypoints of camera {name} come about {describe_lag(lag, rate)}; expected those of "
        "the same time"
        for name, lag in late.items()
    ]


def describe_lag(lag: int, rate: float) -> str:
    """Return a lag in words; negative: early."""
    side = "late" if lag > 0 else "early"
    return f"{abs(lag)} frames {side} ({abs(lag) / rate:.2g} s)"


def _camera_costs(points: np.ndarray, rig: CameraRig, most: int) -> np.ndarray:
    """Return (V, 2 most + 1) each camera's median distance, as a share of the picture's height,
    from where the others see the points (V, F, K, 3), at lags from -most to most."""
    n_views, n_frames, n_points = points.shape[:3]
    rows = np.linspace(most, n_frames - 1 - most, _SAMPLED)
    rows = np.unique(rows.round().astype(int))
    limits = TriangulationConfig(max_error=AGREEING * rig.height, min_confidence=0)
    costs = np.full((n_views, 2 * most + 1), np.nan)
    for view, camera in enumerate(rig):
        others = np.delete(points[:, rows], view, axis=0).reshape(n_views - 1, -1, 3)
        rest = CameraRig(tuple(other for other in rig if other is not camera))
        places = triangulate(rest, others, limits).points
        for number in range(2 * most + 1):
            seen = points[view, rows + number - most].reshape(1, -1, 3)
            errors = reprojection_errors(CameraRig((camera,)), seen, places)[0]
            known = errors[np.isfinite(errors)]
            if len(known) >= n_points:
                costs[view, number] = np.median(known) / camera.size[1]
    return costs


def _gains(costs: np.ndarray, most: int, noise: float) -> np.ndarray:
    """Return (V,) how many times higher the costs (V, 2 most + 1) are without a lag than with the
    best one; 1 where they are unknown."""
    least = np.nanmin(np.where(np.isfinite(costs), costs, np.inf), axis=1)
    return np.nan_to_num((costs[:, most] + noise) / (least + noise), nan=1.0)


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


def _least(points: np.ndarray) -> np.ndarray:
    """Return the least x and y (V, F, 2) of points (V, F, K, 2); NaN without any."""
    least = np.where(np.isfinite(points), points, np.inf).min(axis=2)
    return np.where(np.isfinite(least), least, np.nan)
