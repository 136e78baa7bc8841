"""Motion that people do not make: long walks backward, falls faster than gravity's, steps that are
too fast for the legs.

The first comes from a start that faced the wrong way, the others from a frame rate that is stated
too high. The ground pushes and does not pull, so the centre of mass accelerates downward by at most
g; at twice the rate accelerations are four times as high. Legs swing as pendulums: from a slow walk
to a run of v^2 / (g L) = 3 people take f = 0.4 to 1.0 sqrt(g / L) steps per second (Alexander 1989,
"Optimization and gaits in the locomotion of vertebrates").
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from apf.evaluation.joint_names import match_joints
from apf.report.config import MotionConfig
from apf.tracking.gait import measure_gait
from apf.tracking.track import Track

_GRAVITY = 9.81
#: Share of the body's mass of the segments between two joints, of each side (Winter 2009, table
#: 4.1; hands are counted with forearms, feet with shanks). The rest is trunk and head.
_LIMBS = (
    ("shoulder", "elbow", 0.028),
    ("elbow", "wrist", 0.022),
    ("hip", "knee", 0.100),
    ("knee", "ankle", 0.061),
)
_TRUNK, _HEAD = 0.497, 0.081
#: Cosine of the largest angle between the heading and the direction of a straight walk.
_STRAIGHT = 0.7
#: Height of ankles above the floor, m.
_ANKLE_HEIGHT = 0.08
_JOINTS = {"neck", "head_top", *(f"{s}_{end}" for s in "lr" for pair in _LIMBS for end in pair[:2])}


def find_impossible_motion(track: Track, config: MotionConfig | None = None) -> list[str]:
    """Return what people do not do, a line each; nothing for a body without arms, legs or head, or
    where the person is lost in a tenth of the frames."""
    config = config or MotionConfig()
    columns = match_joints(track.joint_names)
    if not columns.keys() >= _JOINTS or len(track) < 3 or track.lost.mean() > config.lost:
        return []
    place = {name: track.joints[:, column] for name, column in columns.items()}
    found = [_find_backward_walk(track, place, config), _find_fast_fall(track, place, config)]
    if not found[1]:
        found.append(_find_fast_steps(track, place, config))
    return [text for text in found if text]


def _find_backward_walk(
    track: Track, place: dict[str, np.ndarray], config: MotionConfig
) -> str | None:
    """Return a line if most of the walked path leads backward."""
    pelvis = 0.5 * (place["l_hip"] + place["r_hip"])
    velocity = _smooth_derivative(pelvis, track.times, config.window, 1)[:, :2]
    ahead = np.cross(place["l_hip"] - place["r_hip"], [0.0, 0.0, 1.0])[:, :2]
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1), 1e-9)[:, None]
    speed = np.linalg.norm(velocity, axis=1)
    along = np.einsum("fa,fa->f", velocity, ahead)
    walking, seconds = speed > config.walk_speed, np.gradient(track.times)
    backward = float((speed * seconds)[walking & (along < -_STRAIGHT * speed)].sum())
    total = float((speed * seconds)[walking].sum())
    if backward < config.backward_path or backward < config.backward_share * total:
        return None
    return (
        f"the person walks backward ({backward:.1f} m of {total:.1f} m); expected somebody who "
        "faces where they go: if they did, the start faced the wrong way"
    )


def _find_fast_fall(track: Track, place: dict[str, np.ndarray], config: MotionConfig) -> str | None:
    """Return a line if the centre of mass accelerates downward by more than gravity."""
    trunk = 0.5 * (place["neck"] + 0.5 * (place["l_hip"] + place["r_hip"]))
    mass = _TRUNK * trunk + _HEAD * place["head_top"]
    for first, last, share in _LIMBS:
        for side in "lr":
            mass = mass + share * 0.5 * (place[f"{side}_{first}"] + place[f"{side}_{last}"])
    fall = -_smooth_derivative(mass, track.times, config.window, 2)[:, 2]
    known = fall[np.isfinite(fall)]
    if len(known) < 3 / config.fall_share:  # a single frame's jump is no fall
        return None
    greatest = float(np.quantile(known, 1 - config.fall_share))
    if greatest < config.fall * _GRAVITY:
        return None
    return (
        f"the body accelerates downward by {greatest / _GRAVITY:.1f} times gravity; expected at "
        f"most 1: {track.fps:g} frames per second may be too high"
    )


def _find_fast_steps(
    track: Track, place: dict[str, np.ndarray], config: MotionConfig
) -> str | None:
    """Return a line if the steps are faster than legs of this length swing at this speed."""
    filtered = [
        _smooth_derivative(points, track.times, 0.5 * config.window, 0)
        for points in track.joints.swapaxes(0, 1)
    ]
    gait = measure_gait(replace(track, joints=np.stack(filtered, 1)))
    if gait is None:
        return None
    segments = (("hip", "knee"), ("knee", "ankle"))
    legs = [
        np.linalg.norm(place[f"{side}_{a}"] - place[f"{side}_{b}"], axis=1)
        for side in "lr"
        for a, b in segments
    ]
    leg = 0.5 * float(np.nansum(np.nanmedian(legs, axis=1))) + _ANKLE_HEIGHT
    steps, froude = gait.cadence / 60, gait.speed**2 / (_GRAVITY * leg)
    most = config.fast_steps if config.walks_on < froude < config.sprints else config.most_steps
    if steps * np.sqrt(leg / _GRAVITY) < most:
        return None
    return (
        f"the person takes {steps:.1f} steps per second at {gait.speed:.1f} m/s; expected at most "
        f"{most / np.sqrt(leg / _GRAVITY):.1f} with legs of {leg:.2f} m: {track.fps:g} frames per "
        "second may be too high"
    )


def _smooth_derivative(
    points: np.ndarray, times: np.ndarray, width: float, order: int
) -> np.ndarray:
    """Return a derivative (F, 3) of points (F, 3) at times (F,) s, after a Gaussian filter with a
    standard deviation of `width` s; of the second NaN within two of them of the ends."""
    from scipy.ndimage import gaussian_filter1d  # takes a while to load

    known = np.isfinite(points).all(1)
    if known.sum() < 3:
        return np.full(points.shape, np.nan)
    step = float(np.median(np.diff(times)))
    even = np.arange(times[0], times[-1] + step / 2, step)
    columns = [np.interp(even, times[known], axis) for axis in points[known].T]
    sigma = max(width / step, 0.8)
    found = gaussian_filter1d(np.stack(columns, 1), sigma, axis=0, order=order, mode="nearest")
    found /= step**order
    if order > 1:
        rim = int(np.ceil(2 * sigma))
        found[:rim], found[max(len(found) - rim, 0) :] = np.nan, np.nan
    return np.stack([np.interp(times, even, axis) for axis in found.T], 1)
