"""scripts/spoil_keypoints.py: keypoints that are wrong or missing."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from helpers import scenes
from helpers.keypoints import of_poses
from helpers.shared import ROOT

sys.path.insert(0, str(ROOT / "scripts"))

import spoil_keypoints

from apf.body import load_body


def test_each_way_spoils_what_it_says() -> None:
    body = load_body("song31")
    keypoints = of_poses(scenes.ring(3), body, np.tile(body.rest_pose, (8, 1)))
    wrong = {
        kind: np.any(spoil_keypoints.spoilt(keypoints, kind, 1).points != keypoints.points, -1)
        for kind in spoil_keypoints.KINDS
    }
    assert not wrong["clean"].any()
    assert 0.1 < wrong["outliers"].mean() < 0.3
    assert wrong["missing"][1].all() and not wrong["missing"][[0, 2]].any()
    nose = keypoints.names.index("nose")
    sides = wrong["exchanged"][1]
    assert not sides[:, nose].any() and np.delete(sides, nose, 1).all()
    assert not wrong["exchanged"][[0, 2]].any()


def test_a_folder_without_a_sequence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["spoil_keypoints.py", "nothing"])
    assert spoil_keypoints.main() == 2
