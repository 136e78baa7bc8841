"""Comparing a track with the truth, as a library and through `apf evaluate`."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import tracks
from helpers.commands import succeed
from helpers.striders import strider

from apf.evaluation.conventions import axes_that_fit
from apf.evaluation.evaluate import evaluate
from apf.evaluation.joint_names import EVALUATED_JOINTS, match_joints
from apf.evaluation.truth import load_truth
from apf.formats.trc import CONVENTIONS, JointSeries, write_trc
from apf.formats.writers import WRITERS


def moved(truth: JointSeries, joint: str, offset: list[float], rows: slice) -> JointSeries:
    joints = truth.joints.copy()
    joints[rows, truth.joint_names.index(joint)] += offset
    return replace(truth, joints=joints)


def test_mean_and_lost_share() -> None:
    track = tracks.walker(frames=30)
    truth = moved(tracks.truth_of(track), "l_knee", [0.3, 0, 0.4], slice(0, 15))
    evaluation = evaluate(track, truth)
    assert evaluation.mean_error == pytest.approx(0.5 / 2 / 15)
    assert evaluation.lost_share == pytest.approx(1 / 30)
    assert not any(evaluation.lost_limbs.values())
    np.testing.assert_allclose(evaluation.frame_errors, [0.5 / 15] * 15 + [0] * 15)
    row = next(row for row in evaluation.joint_table() if row["joint"] == "l_knee")
    assert (row["mean_mm"], row["median_mm"], row["max_mm"]) == (250, 250, 500)


def test_constant_part_turns_with_the_body() -> None:
    """An offset fixed in the body is constant, one fixed in the world of a turning body is not."""
    track = tracks.walker(frames=200)
    truth = tracks.truth_of(track)
    turning, fixed, *hips = map(EVALUATED_JOINTS.index, ("l_elbow", "r_elbow", "l_hip", "r_hip"))
    joints = truth.joints.copy()
    left = joints[:, hips[0]] - joints[:, hips[1]]
    joints[:, turning] += 0.05 * left / np.linalg.norm(left, axis=1, keepdims=True)
    joints[:, fixed] += [0.05, 0, 0]
    constant, rest = evaluate(track, replace(truth, joints=joints)).constant_and_rest
    assert constant[turning] == pytest.approx(0.05, abs=1e-6)
    assert rest[turning] == pytest.approx(0, abs=1e-6)
    assert rest[fixed] > 0.02


@pytest.mark.parametrize(
    ("rows", "lost"),
    [
        (slice(5, 15), False),  # 10 frames on end are not more than 10
        (slice(5, 16), True),
        (slice(28, 30), True),  # at the end
        (slice(28, 29), False),
    ],
)
def test_lost_limbs(rows: slice, lost: bool) -> None:
    track = tracks.walker(frames=30)
    evaluation = evaluate(track, moved(tracks.truth_of(track), "r_wrist", [0, 0.21, 0], rows))
    assert evaluation.lost_limbs.pop("right arm") is lost
    assert not any(evaluation.lost_limbs.values())


def test_frames_are_matched_by_index_and_gaps_in_the_truth_counted() -> None:
    track = tracks.walker(frames=20, start=10)
    truth = tracks.truth_of(track)
    joints = truth.joints[:12].copy()
    joints[0] = np.nan  # frame 10: nothing known
    joints[3, 4, 1] = joints[:, EVALUATED_JOINTS.index("neck")] = np.nan
    evaluation = evaluate(track, replace(truth, joints=joints, frames=truth.frames[:12]))
    np.testing.assert_array_equal(evaluation.frames, np.arange(11, 22))
    assert evaluation.mean_error == 0 and evaluation.n_ignored == 14 + 1 + 12
    assert "neck" in set(evaluation.unmatched_truth) - set(evaluation.joint_names)
    assert evaluation.warnings == ("the truth covers 12 of the track's 20 frames",)
    assert evaluation.summary()["constant_mm"] is None  # no body frame without the neck


def test_truth_of_another_rate_or_without_a_pelvis() -> None:
    track = tracks.walker()
    truth = tracks.truth_of(track)
    double = np.repeat(truth.joints, 2, axis=0)
    double[1::2] += 1  # between the track's frames
    frames = np.arange(len(double)) + 2 * truth.frames[0]
    found = evaluate(track, replace(truth, joints=double, frames=frames, fps=2 * track.fps))
    assert found.mean_error < 1e-6
    np.testing.assert_array_equal(found.frames, evaluate(track, truth).frames)
    evaluation = evaluate(track, replace(truth, joint_names=("", *truth.joint_names[1:])))
    hips = truth.joints[:, [EVALUATED_JOINTS.index(f"{s}_hip") for s in "lr"]].mean(axis=1)
    expected = np.linalg.norm(truth.joints[:, 0] - hips, axis=-1)
    pelvis = evaluation.joint_names.index("pelvis")
    np.testing.assert_allclose(evaluation.errors[:, pelvis], expected, atol=1e-12)


@pytest.mark.parametrize("ending", [".trc", ".c3d", ".npz"])
def test_markers_at_0_0_0_are_missing(tmp_path: Path, ending: str) -> None:
    truth = tracks.truth_of(tracks.walker())
    joints = truth.joints.copy()
    joints[3:5, 1] = 0
    path = tmp_path / f"zeros{ending}"
    if ending == ".npz":
        np.savez(path, joint_names=truth.joint_names, joints=joints, fps=truth.fps)
    else:
        WRITERS[ending](path, replace(truth, joints=joints))
    gone = np.isnan(load_truth(path).joints).all(-1)
    assert gone[3:5, 1].all() and gone.sum() == np.isnan(truth.joints).all(-1).sum() + 2


def test_names_of_other_programs() -> None:
    pose2sim = ["RHip", "RKnee", "RAnkle", "RBigToe", "LHip", "Neck", "Head", "Nose", "LWrist"]
    found = {joint: pose2sim[place] for joint, place in match_joints(pose2sim).items()}
    assert found == {
        "neck": "Neck", "head_top": "Head", "l_wrist": "LWrist", "l_hip": "LHip",
        "r_hip": "RHip", "r_knee": "RKnee", "r_ankle": "RAnkle",
    }  # fmt: skip
    own = ["head", "head_top", "l_hand", "l_wrist", "pelvis", "r_toe"]
    assert match_joints(own) == {"pelvis": 4, "head_top": 1, "l_wrist": 3}
    mixamo = ["mixamorig:Hips", "mixamorig:LeftUpLeg", "mixamorig:LeftLeg", "mixamorig:LeftHand"]
    assert match_joints(mixamo) == {"pelvis": 0, "l_hip": 1, "l_knee": 2, "l_wrist": 3}
    assert match_joints(["left_elbow", "Right Ankle"]) == {"l_elbow": 0, "r_ankle": 1}


# The command ------------------------------------------------------------------------------------


def test_command_writes_table_csv_plot_and_json(tmp_path: Path) -> None:
    """Of a truth 25 mm above the track."""
    out, track = tmp_path / "out", tracks.walker()
    track.save(out / "track.npz")
    joints = track.joints + np.array([0, 0, 0.025])
    np.savez(tmp_path / "truth.npz", joint_names=track.joint_names, joints=joints, fps=60)
    printed = succeed("apf", "evaluate", out, "--truth", tmp_path / "truth.npz").out
    assert "mean error 25.0 mm over 30 frames and 15 joints" in printed and "lost limbs" in printed
    summary = json.loads((out / "evaluation.json").read_text())
    assert summary["mean_error_mm"] == 25 and summary["lost_limbs"] == []
    with (out / "evaluation.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 30 and float(rows[7]["l_ankle_mm"]) == 25
    assert cv2.imread(str(out / "evaluation.png")).std() > 10


def test_the_stated_ellipsoids_are_judged() -> None:
    track = tracks.walker()
    truth = tracks.truth_of(track)
    rng = np.random.default_rng(4)
    truth = replace(truth, joints=truth.joints + rng.normal(0, 0.02, truth.joints.shape))
    assert evaluate(track, truth).summary()["inside_95"] is None
    covariance = np.tile(0.02**2 * np.eye(3), (30, len(track.joint_names), 1, 1))
    covariance[:, track.joint_names.index("l_wrist")] *= 1e-4
    covariance[7] = np.nan
    lost = np.arange(30) == 7
    track = replace(track, diagnostics={"covariance": covariance, "lost": lost})
    found = evaluate(track, truth)
    summary = found.summary()
    assert summary["lost_frames"] == [7]
    shares = {row["joint"]: row["inside_95"] for row in summary["joints"]}
    assert shares.pop("l_wrist") == 0.0
    assert np.mean(list(shares.values())) == pytest.approx(0.95, abs=0.03)
    assert np.isnan(found.inside[7]).all() and np.isfinite(found.inside[8]).all()


def test_toes_are_compared_beside_the_mean() -> None:
    track = strider(20)
    points = track.points
    names = tuple(name.replace("l_toe", "l_toe_tip") for name in points.joint_names)
    joints = points.joints + np.array([0, 0, 0.01])
    found = evaluate(track, JointSeries(names, joints, track.fps, track.frames))
    assert found.toes is not None and found.toes.joint_names == ("l_toe", "r_toe")
    np.testing.assert_allclose(found.toes.errors, 0.01)
    assert not {"l_toe", "r_toe", "l_toe_tip"} & {*found.joint_names, *found.unmatched_truth}
    assert [row["joint"] for row in found.summary()["toes"]] == ["l_toe", "r_toe"]
    joints = JointSeries(track.joint_names, track.joints, track.fps, track.frames)
    assert evaluate(track, joints).toes is None


# Axes and units that are not what was stated ------------------------------------------------------

TRACK = tracks.walker(20)


@pytest.mark.parametrize("written", CONVENTIONS)
@pytest.mark.parametrize("read", [*CONVENTIONS, None])
def test_conventions_are_named_or_found(written: str, read: str | None, tmp_path: Path) -> None:
    """Named by the command where another one is stated, else found."""
    TRACK.save(tmp_path / "track.npz")
    write_trc(tmp_path / "truth.trc", tracks.truth_of(TRACK), written)
    flags = ["--truth", str(tmp_path / "truth.trc"), "--json"]
    flags += ["--convention", read] if read else []
    text = succeed("apf", "evaluate", tmp_path / "track.npz", *flags).out
    named = f"m with --convention {written}" in text
    assert named == ("warning" in text) == (read not in (None, written))
    if read is None:
        assert (f"read with --convention {written}" in text) == (written != "y-up")
        summary = json.loads((tmp_path / "evaluation.json").read_text())
        assert summary["mean_error_mm"] < 1


def test_units_and_axes_without_a_name_and_truth_of_another_take() -> None:
    truth = tracks.truth_of(TRACK)
    turned = np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]])
    noise = np.random.default_rng(0).uniform(-2, 2, truth.joints.shape)
    for joints, said in (
        (truth.joints, "None"),
        (1000 * truth.joints, "coordinates times 0.001"),
        (truth.joints @ turned.T, "m with world axes (x, y, z) = (-Z, X, -Y) of the file"),
        (truth.joints * [1, 1, -1], "which is mirrored"),
        (noise, "is it of this take"),
    ):
        other = replace(truth, joints=joints)
        error = evaluate(TRACK, other).mean_error
        assert said in str(axes_that_fit([(TRACK, other)], error, "z-up"))
