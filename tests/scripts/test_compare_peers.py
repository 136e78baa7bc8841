"""compare_peers.py: figures, files, tables; the peers themselves are not installed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from peers.figures import measure
from peers.programs import JOINTS, order_points
from peers.results import (
    PeerResults,
    PeerRun,
    sequence_table,
    summary_table,
    write_tables,
)

from apf.formats.trc import JointSeries
from cl import InputError

FRAMES = 60
NAMES = (*JOINTS, "neck", "l_toe", "r_toe")


def the_truth() -> JointSeries:
    """A person who turns the arms; both feet stand."""
    random = np.random.default_rng(3)
    joints = np.repeat(random.normal(size=(1, len(NAMES), 3)), FRAMES, axis=0)
    for side, y in (("l", 0.1), ("r", -0.1)):
        joints[:, NAMES.index(f"{side}_hip")] = (0, y, 0.9)
        joints[:, NAMES.index(f"{side}_ankle")] = (0, y, 0.08)
        joints[:, NAMES.index(f"{side}_wrist"), 2] = np.linspace(0, 1, FRAMES) ** 2
    joints[:, NAMES.index("neck")] = (0, 0, 1.5)
    return JointSeries(NAMES, joints, 30.0, np.arange(FRAMES))


def shown(joints: np.ndarray) -> JointSeries:
    return JointSeries(tuple(JOINTS), joints[:, : len(JOINTS)], 30.0, np.arange(FRAMES))


def test_figures_of_known_errors() -> None:
    truth = the_truth()
    moved = truth.joints + np.array([0.010, 0, 0])
    ankle, wrist = NAMES.index("l_ankle"), NAMES.index("r_wrist")
    moved[:, ankle, 1] += np.linspace(0, 0.024, FRAMES)  # it slides
    moved[10:25, wrist] = np.nan
    found = measure(shown(moved), truth)
    assert found.joints["l_knee"] == pytest.approx(10) and found.joints["l_ankle"] > 10
    assert found.gaps == pytest.approx(15 / (12 * FRAMES))
    assert found.skating == pytest.approx(12, abs=0.5)  # 24 mm of one foot, 0 of the other
    assert found.rest < 1 and found.far == 0 and found.jitter < 0.01
    late = JointSeries(tuple(JOINTS), truth.joints[:-6, :12], 30.0, np.arange(FRAMES - 6))
    assert measure(late, truth).gaps == pytest.approx(0.1)  # frames without any position
    noisy = truth.joints.copy()
    noisy[::2] += np.array([0.001, 0, 0])
    assert measure(shown(truth.joints), truth).jitter == pytest.approx(0, abs=1e-9)
    assert measure(shown(noisy), truth).jitter == pytest.approx(2)


def test_runs_are_kept_and_shown(tmp_path: Path) -> None:
    results = PeerResults.read(tmp_path / "peers.json")
    truth = the_truth()
    run = PeerRun("walk", "ours: both", 0, "abacus", "c0ffee")
    figures = measure(shown(truth.joints + np.array([0.004, 0, 0])), truth)
    results.versions["pose2sim"] = {"pose2sim": "0.10.49"}
    results.add(replace(run, figures=figures, clock=2.5))
    results.add(PeerRun("walk", "aniposelib, optimised", 0, "one core", "c0ffee", failed="no"))
    again = PeerResults.read(tmp_path / "peers.json")
    assert again.has("walk", "ours: both", 0) and not again.has("walk", "ours: both", 1)
    assert "| ours: both | 1 | 4.0 | 0.0 |" in summary_table(again).markdown()
    assert "pose2sim 0.10.49" in summary_table(again).markdown()
    assert "| ours: both | 4.0 / 0.0 |" in sequence_table(again).markdown()
    write_tables(tmp_path, again)
    assert "- walk, aniposelib, optimised: no" in (tmp_path / "peers.md").read_text()
    assert len((tmp_path / "peers.csv").read_text().splitlines()) == 3
    (tmp_path / "peers.json").write_text(json.dumps({"runs": 3}))
    with pytest.raises(InputError, match="not the results"):
        PeerResults.read(tmp_path / "peers.json")


def test_points_in_the_order_that_pose2sim_expects() -> None:
    """MediaPipe's 33 by number, whatever a file holds: 12 is the right shoulder, 31 the left toe;
    the left heel, 29, is missing."""
    points = np.arange(2 * 3 * 2 * 3, dtype=float).reshape(2, 3, 2, 3)
    found = order_points(points, ["left_foot_index", "right_shoulder"])
    assert found.shape == (2, 3, 33, 3)
    np.testing.assert_array_equal(found[:, :, 31], points[:, :, 0])
    np.testing.assert_array_equal(found[:, :, 12], points[:, :, 1])
    assert not found[:, :, 29].any()
