"""Several walkers in one room: walks that do not meet, and the frames in which each is there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from apf.synthetic.config import SceneConfig
from apf.synthetic.walk import Course, Walk

#: Mean distances, m, of the two courses from the middle of the room; people on one walk against
#: those on the other.
_OUTER, _INNER = 1.45, 0.7
_WOBBLE = 0.05
#: Least and greatest stature of everybody but the first person, m.
_STATURE = (1.55, 1.90)
#: Speed on the inner course, as a share of that on the outer one.
_INNER_PACE = 0.75


def make_walks(config: SceneConfig) -> list[Walk]:
    """Return a walk for each person: alone as `SceneConfig.walk` is; of several every second one on
    the outer course, the others on the inner one, evenly spaced."""
    if config.people == 1:
        return [config.walk]
    walks = []
    for number in range(config.people):
        rng = np.random.default_rng([config.seed, 6, number])
        height = config.height if number == 0 else rng.uniform(*_STATURE)
        outer = number % 2 == 0
        on_course = (config.people + outer) // 2
        turn = 2 * np.pi * (number // 2 / on_course) + config.seed
        radius = _OUTER if outer else _INNER
        course = Course(radius, _WOBBLE, turn, clockwise=not outer)
        own = Walk.sample(int(rng.integers(2**31)), height)
        pace = 1.0 if outer else _INNER_PACE
        # All on one course walk at one speed, and so stay apart.
        walks.append(replace(own, course=course, speed=1.15 * pace, stride=own.stride * pace))
    return walks


def presence(config: SceneConfig) -> np.ndarray:
    """Return when each person is there, (P, F) bool: always, except that a visitor, the last
    person, comes after a third of the frames, leaves after two thirds, and comes back for the last
    sixth."""
    there = np.ones((config.people, config.frames), bool)
    if config.visitor:
        share = np.arange(config.frames) / config.frames
        there[-1] = ((share >= 1 / 3) & (share < 2 / 3)) | (share >= 5 / 6)
    return there
