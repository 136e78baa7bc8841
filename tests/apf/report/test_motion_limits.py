"""Motion that no person makes is named, and what people do is not."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.striders import strider

from apf.report.motion_limits import find_impossible_motion
from apf.synthetic.gait import GaitModel
from apf.synthetic.walk import Walk
from apf.tracking.track import Track

HALF_TURN = np.diag([-1.0, -1.0, 1.0])


@pytest.fixture(scope="module")
def walk() -> Track:
    """The true joints of `apf synth`'s walker, 3 s of 60 frames/s."""
    track, gait = strider(180), GaitModel(Walk.sample(3, 1.8))
    joints = gait.skeleton.joints(gait.motion(track.times))
    columns = [gait.skeleton.joint_names.index(name) for name in track.joint_names]
    return replace(track, joints=joints[:, columns])


def jumper(rate: float) -> Track:
    """A track whose whole body is thrown 0.4 m up and falls, once a second; its frames per second
    are stated `rate` times too high."""
    track = strider(180)
    flight = np.sqrt(8 * 0.4 / 9.81)
    since = np.clip(track.times % 1.0, 0, flight)
    height = 0.5 * 9.81 * since * (flight - since)
    joints = track.joints[:1] + np.array([0, 0, 1.0]) * height[:, None, None]
    return replace(track, joints=joints, fps=rate * track.fps)


def turned(track: Track) -> Track:
    """The same path by somebody who faces the other way."""
    middle = track.joints[:, [track.joint_names.index("pelvis")]]
    return replace(track, joints=middle + (track.joints - middle) @ HALF_TURN)


def test_sound_motion(walk: Track) -> None:
    assert not find_impossible_motion(walk)
    assert not find_impossible_motion(jumper(1.0))
    still = replace(walk, joints=np.repeat(walk.joints[:1], len(walk), axis=0))
    assert not find_impossible_motion(still)
    assert not find_impossible_motion(turned(still))


def test_a_walk_backward(walk: Track) -> None:
    (line,) = find_impossible_motion(turned(walk))
    assert "walks backward" in line


def test_frame_rates_that_are_too_high(walk: Track) -> None:
    (steps,) = find_impossible_motion(replace(walk, fps=2.2 * walk.fps))
    assert "steps per second" in steps
    (fall,) = find_impossible_motion(jumper(2.0))
    assert "times gravity" in fall


def test_what_is_not_judged(walk: Track) -> None:
    fast = replace(walk, fps=2.2 * walk.fps)
    lost = {**fast.diagnostics, "lost": np.ones(len(fast), bool)}
    assert not find_impossible_motion(replace(fast, diagnostics=lost))
    assert not find_impossible_motion(_rows(fast, 2))


def _rows(track: Track, n: int) -> Track:
    diagnostics = {name: values[:n] for name, values in track.diagnostics.items()}
    return replace(
        track,
        frames=track.frames[:n],
        poses=track.poses[:n],
        joints=track.joints[:n],
        diagnostics=diagnostics,
    )
