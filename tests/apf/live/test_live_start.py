"""Who is followed by `apf live`, and what is said of the others."""

from typing import Any

import numpy as np
import pytest
from helpers import tracks

from apf.cli.live import compare_with_truth
from apf.evaluation.truth import load_people_truth
from apf.live.session import LiveResult


def test_one_is_compared_with_the_nearest(tmp_path: Any) -> None:
    track = tracks.walker(4)
    joints = np.stack([track.joints + np.array([x, 0, 0]) for x in (1.0, 0.01)], axis=1)
    path = tmp_path / "truth.npz"
    np.savez(path, joint_names=np.array(track.joint_names), joints=joints, fps=track.fps)
    result = LiveResult(latencies=[0.0] * 4)
    errors = compare_with_truth([track], result, load_people_truth(path))
    assert errors["error_mm"] == pytest.approx(10, abs=0.01)
