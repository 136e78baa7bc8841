"""Events and parameters of walks whose truth is known."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from helpers import tracks
from helpers.striders import STANCE, Stride, strider, synthetic_walker, track_of_poses

from apf.body.toml import load_body
from apf.synthetic.walk import Walk
from apf.tracking.gait import measure_gait
from apf.tracking.smoothing import smooth_track


@pytest.mark.parametrize("seed", [0, 3])
def test_a_synthetic_walker(seed: int) -> None:
    walk = Walk.sample(seed, 1.6 + 0.1 * seed)
    gait = measure_gait(synthetic_walker(walk, 240))
    assert gait is not None
    assert gait.n_steps in (6, 7, 8)
    assert gait.cadence == pytest.approx(120 * walk.speed / walk.stride, rel=0.01)
    assert gait.step_length == pytest.approx(walk.stride / 2, rel=0.01)
    assert gait.speed == pytest.approx(walk.speed, rel=0.01)
    stride = walk.stride / walk.speed  # s
    for event in gait.events:
        begun = event.time / stride + walk.start_phase + 0.5 * (event.side == "right")
        late = (begun - (0.62 if event.kind == "off" else 0) + 0.5) % 1 - 0.5
        assert abs(late * stride) < 0.05, event


def test_a_tracked_body_with_noise() -> None:
    stride = Stride()
    gait = measure_gait(smooth_track(strider(240, stride, noise=0.02)))
    assert gait is not None
    assert gait.cadence == pytest.approx(120, rel=0.03)
    assert gait.step_length == pytest.approx(0.5, rel=0.03)
    assert gait.speed == pytest.approx(1.0, rel=0.03)
    strikes = [event for event in gait.events if event.kind == "strike"]
    assert gait.n_steps == len(strikes) - 1 >= 5
    assert {a.side != b.side for a, b in pairwise(strikes)} == {True}
    for event in gait.events:
        done = event.time * stride.speed / stride.length + 0.5 * (event.side == "right")
        late = (done - (STANCE if event.kind == "off" else 0) + 0.5) % 1 - 0.5
        assert abs(late) < 0.08, event
    plain = json.loads(json.dumps(gait.describe()))
    assert plain["n_steps"] == gait.n_steps and len(plain["events"]) == len(gait.events)
    assert plain["events"][0]["step_length_m"] is None


def test_who_does_not_walk_or_is_lost_between_steps() -> None:
    walker, upper = strider(60), load_body("rymut31_upper")
    for track in (
        tracks.walker(0),
        strider(40),  # one step
        track_of_poses(walker.its_body, np.tile(walker.poses[:1], (60, 1))),
        replace(walker, joints=walker.joints - walker.joints[:, :1]),  # marks time
        track_of_poses(upper, np.tile(upper.rest_pose, (60, 1))),
    ):
        assert measure_gait(track) is None
    track = strider(300)
    whole, parted = measure_gait(track), measure_gait(tracks.lose(track, np.arange(100, 110)))
    assert whole is not None and parted is not None
    assert parted.n_steps < whole.n_steps
    assert all(event.frame >= 110 for event in parted.events)
