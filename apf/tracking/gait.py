"""Gait events and parameters: foot strikes and foot offs, steps, cadence, speed.

Zeni, Richards & Higginson 2008, "Two simple methods for determining gait events during treadmill
and overground walking using kinematic data": a foot lands when it is farthest in front of the
pelvis along the direction of progress, and leaves the floor when it is farthest behind it. The
joints come from a smoothed track. In the shipped bodies, whose feet do not bend, the ankles replace
heels and toes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from apf.body.stature import ANKLES, HIPS
from apf.tracking.track import Track
from psfs.common.numbers import STEP_SECONDS, find_true_runs

#: Least speed, m/s, of the pelvis that counts as walking: old people's slow walk is about 0.6.
#: Least range, m, of a foot's motion relative to the pelvis in every stride.
_LEAST_SPEED, _LEAST_SWING = 0.3, 0.15
#: The joints whose middle is the pelvis if the body has no pelvis joint.
_HIP_JOINTS = ("l_hip", "r_hip")


@dataclass(frozen=True)
class GaitEvent:
    """A foot strike (`strike`) or foot off (`off`).

    side: left or right. frame: of the sequence, and its time, s. length: of a strike, m, from the
    place where the other foot stands to the place where this one will stand, along the path of the
    pelvis from above the one to above the other; None for the first strike.
    """

    kind: str
    side: str
    frame: int
    time: float
    length: float | None = None


@dataclass(frozen=True)
class Gait:
    """A walk. events: in order of time. n_steps: number of strikes but the first. cadence:
    steps/min. step_length: m, mean over the steps. speed: m/s of the pelvis from the first strike
    to the last."""

    events: tuple[GaitEvent, ...]
    n_steps: int
    cadence: float
    step_length: float
    speed: float

    def describe(self) -> dict[str, object]:
        """Return all figures as plain values with units in their names, for JSON."""
        return {
            "n_steps": self.n_steps,
            "cadence_steps_per_min": round(self.cadence, 2),
            "step_length_m": round(self.step_length, 4),
            "speed_m_s": round(self.speed, 4),
            "events": [
                {
                    "kind": event.kind,
                    "side": event.side,
                    "frame": event.frame,
                    "time_s": round(event.time, 4),
                    "step_length_m": None if event.length is None else round(event.length, 4),
                }
                for event in self.events
            ],
        }


def measure_gait(track: Track) -> Gait | None:
    """Return the longest walk in `track`, which should be smoothed.

    Returns None if nobody walks two steps, or if the body has no pelvis or ankles.
    """
    place = dict(zip(track.joint_names, track.joints.swapaxes(0, 1), strict=True))
    if HIPS not in place and set(_HIP_JOINTS) <= set(place):
        place[HIPS] = sum(place[name] for name in _HIP_JOINTS) / 2
    if not {HIPS, *ANKLES} <= set(place):
        return None
    points = np.stack([place[name] for name in (HIPS, *ANKLES)], 1)
    known = np.isfinite(points).all(axis=(1, 2)) & ~track.lost
    walks = [_measure_walk(track, run, points[run]) for run in find_true_runs(known)]
    return max((walk for walk in walks if walk), key=lambda walk: walk.n_steps, default=None)


def _measure_walk(track: Track, run: slice, points: np.ndarray) -> Gait | None:
    """Return the walk in frames without a gap, or None; points (F, 3, 3) m: pelvis, left ankle,
    right ankle."""
    times, pelvis = track.times[run], points[:, 0, :2]
    if len(times) < 3:
        return None
    velocity = _measure_velocity(pelvis, times)
    speed = np.linalg.norm(velocity, axis=1)
    walking = speed > _LEAST_SPEED
    if not walking.any():
        return None
    ahead = velocity / np.maximum(speed, 1e-9)[:, None]
    reach = np.einsum("fka,fa->fk", points[:, 1:, :2] - pelvis[:, None], ahead)
    steps = [
        (row, kind, foot)
        for foot in range(2)
        for kind, sign in (("strike", 1.0), ("off", -1.0))
        for row in find_peaks(sign * reach[:, foot], _LEAST_SWING)
        if walking[row]
    ]
    strikes = sorted((row, foot) for row, kind, foot in steps if kind == "strike")
    if len(strikes) < 3:  # fewer than two steps
        return None
    lengths = _measure_steps(strikes, points, reach)
    frames = track.frames[run]
    events = [
        GaitEvent(
            kind,
            ("left", "right")[foot],
            int(frames[row]),
            float(times[row]),
            lengths.get((row, foot)) if kind == "strike" else None,
        )
        for row, kind, foot in sorted(steps)
    ]
    first, last = strikes[0][0], strikes[-1][0]
    path = np.linalg.norm(np.diff(pelvis[first : last + 1], axis=0), axis=1).sum()
    seconds = float(times[last] - times[first])
    return Gait(
        events=tuple(events),
        n_steps=len(strikes) - 1,
        cadence=60 * (len(strikes) - 1) / seconds,
        step_length=float(np.mean(list(lengths.values()))),
        speed=float(path) / seconds,
    )


def find_peaks(values: np.ndarray, prominence: float) -> list[int]:
    """Return where values (N,) have peaks from which they fall by `prominence` or more, on either
    side, before they are higher. As `scipy.signal.find_peaks`, which takes a second to import."""
    peaks, low, high = list[int](), 0, -1  # the lowest since the last peak, the highest since that
    heights = values.tolist()
    for row, height in enumerate(heights):
        if high < 0:
            if height < heights[low]:
                low = row
            elif height - heights[low] >= prominence:
                high = row
        elif height > heights[high]:
            high = row
        elif heights[high] - height >= prominence:
            peaks.append(high)
            low, high = row, -1
    return peaks


def _measure_steps(
    strikes: list[tuple[int, int]], points: np.ndarray, reach: np.ndarray
) -> dict[tuple[int, int], float]:
    """Return the step length, m, of every strike (row, foot) but the first.

    A foot stands where its ankle is when the pelvis passes over it, or where it lands if the walk
    ends before that.
    """
    pelvis, places = [], []
    for row, foot in strikes:
        passed = np.flatnonzero(reach[row:, foot] <= 0)
        over = row + int(passed[0]) if len(passed) else row
        pelvis.append(points[over, 0, :2])
        places.append(points[over, 1 + foot, :2])
    ways, steps = np.diff(pelvis, axis=0), np.diff(places, axis=0)
    lengths = np.sum(ways * steps, 1) / np.maximum(np.linalg.norm(ways, axis=1), 1e-9)
    return dict(zip(strikes[1:], lengths.tolist(), strict=True))


def _measure_velocity(points: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return (F, 2) m/s, the mean velocity of points (F, 2) over `STEP_SECONDS` around each
    frame."""
    before = np.clip(times - 0.5 * STEP_SECONDS, times[0], None)
    after = np.clip(times + 0.5 * STEP_SECONDS, None, times[-1])
    moved = [
        np.interp(after, times, points[:, axis]) - np.interp(before, times, points[:, axis])
        for axis in range(2)
    ]
    return np.stack(moved, -1) / (after - before)[:, None]
