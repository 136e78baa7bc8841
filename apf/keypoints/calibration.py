"""Cameras in metres, Z up, from the keypoints of a person who moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from apf.body.stature import stature as stature_of
from apf.body.toml import load_body
from apf.keypoints.keypoints import Keypoints
from apf.keypoints.landmarks import find_landmarks, locate_points
from cl import InputError
from psfs.calibration.scene import turn_to_up
from psfs.cameras.camera import Camera
from psfs.cameras.names import join_names
from psfs.cameras.units import scale_rig
from psfs.self_calibration.config import PersonConfig
from psfs.self_calibration.points.calibrator import PointCalibration, calibrate_by_points
from psfs.self_calibration.world import fit_floor, transform_rig

#: Landmarks that are used, each of both sides. Networks guess faces that are turned away, and put
#: hips elsewhere in each view.
_USED = ("shoulder", "elbow", "wrist", "knee", "ankle", "heel", "big_toe", "small_toe")
#: Segments whose lengths tell the scale, together with the distance from ankles to shoulders.
_SEGMENTS = (("shoulder", "elbow"), ("elbow", "wrist"), ("knee", "ankle"))
#: Standard deviation of an upright person's lean, rad: how firmly up is held where the person stays
#: in place and so does not tell the floor.
_LEAN = 0.08
#: Fewest landmarks; share of the greatest distance of ankles and shoulders above which a person is
#: upright.
_FEWEST, _UPRIGHT = 8, 0.95
#: The body whose proportions tell the scale.
_BODY = "song32"


def calibrate_by_keypoints(
    cameras: Sequence[Camera], keypoints: Keypoints, rate: float, config: PersonConfig
) -> PointCalibration:
    """Estimate the cameras' poses and lags from keypoints in their pictures at `rate` per second.

    cameras: with the intrinsics that are kept, unless `config.focal` says otherwise. The
    world has Z up, Z = 0 on the floor, and the scale of `config.stature`. Raises InputError if the
    cameras cannot be found, or if the keypoints are no landmarks.
    """
    landmarks = find_landmarks(keypoints.names)
    used = {k: at.name for k, at in landmarks.items() if at.name.split("_", 1)[-1] in _USED}
    if len(used) < _FEWEST:
        raise InputError(
            f"the keypoints have {len(used)} of the points that are used ({join_names(_USED)}, of "
            f"both sides); expected {_FEWEST} or more"
        )
    names = list(used.values())
    longest = round(config.longest_lag * rate)
    points = keypoints.points[:, :, list(used)]
    result = calibrate_by_points(cameras, points, longest, config, _find_segments(names))
    body = load_body(_BODY)  # standing, over the floor
    located, size = locate_points(body, names), config.stature / stature_of(body)
    positions = located.place(body, np.zeros((1, body.n_dof)))[0] * size
    positions[:, 2] -= positions[:, 2].min()
    return _align(result, names, dict(zip(located.names, positions, strict=True)))


def _find_segments(names: list[str]) -> list[tuple[int, int]]:
    """Return the pairs of landmarks, by their index, whose distance stays the same."""
    segments = [[f"{side}_{name}" for name in pair] for side in "lr" for pair in _SEGMENTS]
    return [(names.index(a), names.index(b)) for a, b in segments if a in names and b in names]


def _align(
    result: PointCalibration, names: list[str], standing: dict[str, np.ndarray]
) -> PointCalibration:
    """Return the calibration in metres, Z up, with Z = 0 on the floor below the person's middle."""
    size = _measure_scale(result.points, names, standing)
    points = size * result.points
    rig = scale_rig(result.rig, size)
    R = turn_to_up(_measure_up(points, names), rig[0].R[0])
    ankles = [k for k, name in enumerate(names) if name.endswith("_ankle")]
    low = _find_lowest(points[:, ankles] @ R.T)
    R = turn_to_up(R.T @ fit_floor(low, _LEAN), rig[0].R[0])
    local = points @ R.T
    middle = np.nanmedian(local.reshape(-1, 3), axis=0)
    floor = np.median(_find_lowest(local[:, ankles])[:, 2]) - standing[names[ankles[0]]][2]
    origin = np.array([*middle[:2], floor])
    return replace(result, rig=transform_rig(rig, R, -origin), points=local - origin)


def _measure_scale(points: np.ndarray, names: list[str], standing: dict[str, np.ndarray]) -> float:
    """Return the metres per unit of points (F, K, 3), by the sum of the median lengths of
    segments and of the distance from ankles to shoulders."""
    lengths = [float(np.linalg.norm(_measure_up(points, names)))]
    ends = [standing[f"l_{name}"] for name in ("shoulder", "ankle")]
    wanted = [float((ends[0] - ends[1])[2])]
    for a, b in _find_segments(names):
        apart = np.linalg.norm(points[:, a] - points[:, b], axis=-1)
        lengths.append(float(np.nanmedian(apart)))
        wanted.append(float(np.linalg.norm(standing[names[a]] - standing[names[b]])))
    return sum(wanted) / sum(lengths)


def _measure_up(points: np.ndarray, names: list[str]) -> np.ndarray:
    """Return the mean vector (3,) from the ankles to the shoulders while these are far apart: the
    person does not bend then."""
    ends = []
    for name in ("ankle", "shoulder"):
        columns = [k for k, column in enumerate(names) if column.endswith(f"_{name}")]
        if len(columns) < 2:
            raise InputError(
                f"the keypoints have no {name}s; expected them, for they tell what is up"
            )
        ends.append(points[:, columns].mean(axis=1))
    along = ends[1] - ends[0]
    along = along[np.isfinite(along).all(axis=-1)]
    if not len(along):
        raise InputError("ankles and shoulders are never seen together; expected the whole person")
    length = np.linalg.norm(along, axis=1)
    return np.asarray(along[length >= _UPRIGHT * np.percentile(length, 90)].mean(axis=0))


def _find_lowest(feet: np.ndarray) -> np.ndarray:
    """Return the lowest (F', 3) of the points (F, K, 3) of each frame in which some are seen."""
    seen = feet[np.any(np.all(np.isfinite(feet), axis=-1), axis=1)]
    if len(seen) < 3:
        raise InputError("the feet are seen too seldom; expected the whole person")
    return np.asarray(seen[np.arange(len(seen)), np.nanargmin(seen[..., 2], axis=1)])
