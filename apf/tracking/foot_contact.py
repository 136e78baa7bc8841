"""Foot contact: detect when a foot stands, and stop standing feet from sliding.

A foot stands while its ankle is low and slow; not every body has feet that turn. A standing foot is
held at its median position by inverse kinematics of the leg; before and after the stance, the
correction fades (Kovar, Schreiner & Gleicher 2002, "Footskate cleanup for motion capture editing").
"""

from __future__ import annotations

import numpy as np

from apf.body.kinematics import posed_cones, posed_joints
from apf.body.limbs import limb_joints, limb_masks, solve_inverse_kinematics
from apf.body.model import BodyModel, sideless
from apf.body.stature import ANKLES
from apf.initialisation.personal import FLOOR
from psfs.common.numbers import find_true_runs

#: Speed along the floor, m/s, and height, m, above the usual level of the lower foot's ankle below
#: which a foot stands: true feet stand below 0.3 m/s and swing at up to 4, and a heel off the floor
#: lifts the ankle.
_SLOW, _LOW = 0.5, 0.05
#: A moment, s: time over which the speed is computed and the correction of a held foot fades in and
#: out, least duration of a stance and of a swing between two, a sixth of usual ones.
_MOMENT = 0.1
#: Distance, m, along the floor above which a foot slides and does not stand.
_LONGEST_SLIDE = 0.12
#: Height, m, above the lowest one of the stance below which the heel is on the floor, too.
_FLAT_HEIGHT = 0.025
#: Steps that raise soles, and angle, rad, over which their slopes are taken.
_STEPS, _SMALL = 4, 1e-4
#: Distance, m, of an ankle from its place from which on the leg is moved.
_NEAR = 5e-4


def find_ankles(body: BodyModel) -> list[int]:
    """Return the indices of the left and the right ankle among the joints of `body`; an empty list
    if it lacks one."""
    names = body.joint_names
    return [names.index(name) for name in ANKLES] if set(ANKLES) <= set(names) else []


def detect_standing(ankles: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return (F, K) bool: whether each foot stands.

    ankles: (F, K, 3) m, smooth, NaN where unknown, at `times` (F,) s.
    """
    n_feet = ankles.shape[1]
    stands: np.ndarray = np.zeros((len(ankles), n_feet), bool)
    known = np.all(np.isfinite(ankles), axis=(1, 2))
    if known.sum() < 2 or not n_feet:
        return stands
    speed: np.ndarray = np.full((len(ankles), n_feet), np.inf)
    for part in find_true_runs(known):
        speed[part] = _measure_speed(ankles[part, :, :2], times[part], _MOMENT)
    height = ankles[..., 2] - np.percentile(ankles[known, :, 2].min(axis=1), 10)
    steady = (speed < _SLOW) & (height < _LOW)
    for foot in range(n_feet):
        for gap in find_true_runs(~steady[:, foot] & known):
            inside = gap.start > 0 and gap.stop < len(times) and known[gap.start - 1 : gap.stop + 1]
            if np.all(inside) and times[gap.stop] - times[gap.start] < _MOMENT:
                steady[gap, foot] = True
        for stance in find_true_runs(steady[:, foot]):
            if times[stance.stop - 1] - times[stance.start] >= _MOMENT:
                corners = np.ptp(ankles[stance, foot, :2], axis=0)
                stands[stance, foot] = np.linalg.norm(corners) < _LONGEST_SLIDE
    return stands


def detect_flat_feet(ankles: np.ndarray, stands: np.ndarray) -> np.ndarray:
    """Return (F, K) bool: whether each foot stands with its heel on the floor.

    ankles: (F, K, 3) m. stands: (F, K) bool, see `detect_standing`.
    """
    flat = np.zeros_like(stands)
    for foot in range(stands.shape[1]):
        for stance in find_true_runs(stands[:, foot]):
            height = ankles[stance, foot, 2]
            flat[stance, foot] = height < np.percentile(height, 10) + _FLAT_HEIGHT
    return flat


def _measure_speed(points: np.ndarray, times: np.ndarray, window: float) -> np.ndarray:
    """Return the speed (F, K) m/s of points (F, K, A) over `window` s around each frame."""
    last = np.searchsorted(times, times + 0.5 * window + 1e-9, side="right") - 1
    first = np.searchsorted(times, times - 0.5 * window - 1e-9)
    first, last = np.minimum(first, len(times) - 2), np.maximum(last, 1)
    first, last = np.maximum(np.minimum(first, last - 1), 0), np.minimum(last, len(times) - 1)
    seconds = np.maximum(times[last] - times[first], 1e-9)[:, None]
    return np.linalg.norm(points[last] - points[first], axis=-1) / seconds


def hold_feet(
    body: BodyModel, poses: np.ndarray, times: np.ndarray, stands: np.ndarray
) -> np.ndarray:
    """Return `poses` (F, D), changed so that each foot stays at one place on the floor while it
    stands.

    The poses are smooth, at `times` (F,) s, without gaps. stands: (F, K), see `find_ankles`.
    Heights do not change, because the heel rises before the foot leaves the floor.
    """
    if not stands.any():
        return poses
    ankles = find_ankles(body)
    offsets = _find_corrections(posed_joints(body, poses)[:, ankles], times, stands)
    targets = posed_joints(body, poses)[:, ankles] + offsets
    moved = np.abs(offsets).max((1, 2)) > 0
    if not moved.any():  # a foot that stands in a single frame
        return poses
    joints = np.isin(np.arange(len(body.joints)), ankles)
    legs: np.ndarray = np.any(limb_masks(body)[limb_joints(body)[:, ankles].any(1)], axis=0)
    places = posed_joints(body, poses[moved])
    places[:, ankles] = targets[moved]
    out = poses.copy()
    out[moved] = solve_inverse_kinematics(body, poses[moved], legs, joints, places, near=_NEAR)
    return out


def _find_corrections(ankles: np.ndarray, times: np.ndarray, stands: np.ndarray) -> np.ndarray:
    """Return the correction (F, K, 3) m of each foot along the floor: the offset to its median
    position while it stands, which fades before and after."""
    offsets = np.zeros_like(ankles)
    for foot in range(ankles.shape[1]):
        for stance in find_true_runs(stands[:, foot]):
            place = ankles[stance, foot]
            offsets[stance, foot, :2] = (np.median(place, 0) - place)[:, :2]
            for edge, frames in (
                (stance.start, range(stance.start - 1, -1, -1)),
                (stance.stop - 1, range(stance.stop, len(times))),
            ):
                for frame in frames:
                    share = 1 - abs(times[frame] - times[edge]) / _MOMENT
                    if share <= 0 or stands[frame, foot]:
                        break
                    smooth = share * share * (3 - 2 * share)
                    offsets[frame, foot] += smooth * offsets[edge, foot]
    return offsets


def raise_soles(body: BodyModel, poses: np.ndarray) -> np.ndarray:
    """Return poses (F, D) whose feet are turned about their ankles until their soles are above the
    floor, z = 0, or level where they cannot be. Feet that do not turn stay, and all feet do where
    the floor is elsewhere, see `FLOOR`."""
    feet = [k for k, cone in enumerate(body.cones) if sideless(cone.name) == "foot"]
    bones = [body.bones[body.cones[k].bone] for k in feet]
    turning = [bone.axes for bone in bones if sideless(bone.name) == "foot"]
    pitch = [axis.dof for axes in turning for axis in axes if axis.kind == "ry"]

    def soles(poses: np.ndarray) -> np.ndarray:  # (F, K, 2) heights of the soles' ends
        cones = posed_cones(body, poses)[:, feet]
        return np.asarray(cones[..., [2, 6]] - cones[..., [3, 7]])

    lowest = soles(poses).min((1, 2), initial=0.0)
    if len(pitch) != len(feet) or not lowest.any() or np.median(lowest) < -FLOOR:
        return poses
    out, low, high = poses.copy(), body.lower[pitch], body.upper[pitch]
    for _ in range(_STEPS):
        heights, turned = soles(out), out.copy()
        turned[:, pitch] += _SMALL
        slopes = (soles(turned) - heights) / _SMALL
        end = heights.argmin(-1)[..., None]
        height, slope = (np.take_along_axis(v, end, -1)[..., 0] for v in (heights, slopes))
        with np.errstate(divide="ignore", invalid="ignore"):
            up = np.nan_to_num(np.where(height < 0, -height / slope, 0.0))
            level = np.nan_to_num(-np.diff(heights) / np.diff(slopes))[..., 0]
        turns = np.where(np.abs(up) < np.abs(level), up, level * (height < 0))
        out[:, pitch] = np.clip(out[:, pitch] + turns, low, high)
    return out
