"""The first pose: read from a file, fitted to joints."""

from pathlib import Path

import numpy as np
import pytest
from helpers import bodies

from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.body.toml import load_body
from apf.evaluation.joint_names import EVALUATED_JOINTS
from apf.formats.pose import read_pose, write_pose
from apf.initialisation.from_joints import fit_to_joints
from cl import InputError

SONG = load_body("song31")


def random_person(seed: int) -> tuple[BodyModel, np.ndarray, dict[str, np.ndarray]]:
    """song31 with other bone lengths, somewhere, turned anyhow: body, pose (D,), its joints."""
    random = np.random.default_rng(seed)
    body = SONG.scaled({group: random.uniform(0.85, 1.15) for group in SONG.scale_groups})
    pose = bodies.random_poses(SONG, 1, seed)[0]
    pose[:4] += random.uniform([-3, -3, -0.1, -np.pi], [3, 3, 0.1, np.pi])
    joints = posed_joints(body, pose[None])[0]
    return body, pose, dict(zip(body.joint_names, joints, strict=True))


def segments(body: BodyModel, joints: np.ndarray) -> np.ndarray:
    return np.array([np.linalg.norm(joints[a] - joints[b]) for a, b in body.edges])


def test_fit_recovers_joints_and_lengths() -> None:
    body, pose, joints = random_person(1)
    fitted, found, error = fit_to_joints(SONG, joints)
    reached = posed_joints(fitted, found[None])[0]
    target = np.stack([joints[name] for name in fitted.joint_names])
    distance = np.linalg.norm(reached - target, axis=-1)
    assert distance.max() < 0.004
    assert error == pytest.approx(np.sqrt(np.mean(distance**2)))
    np.testing.assert_allclose(segments(fitted, reached), segments(body, target), atol=0.004)
    # Limbs, whose lengths joints measure directly.
    for cone in ("l_thigh", "r_calf", "l_upper_arm"):
        mine, theirs = (
            np.linalg.norm(b.cones[b.cone_names.index(cone)].end) for b in (fitted, body)
        )
        assert mine == pytest.approx(theirs, abs=0.005)
    assert np.all((found >= SONG.lower) & (found <= SONG.upper))
    turn = (found - pose)[SONG.dof_names.index("pelvis.rz")]
    assert abs((turn + np.pi) % (2 * np.pi) - np.pi) < 0.15


def test_unknown_and_missing_joints_are_passed_over_and_wrong_or_too_few_ones_told() -> None:
    _, _, joints = random_person(7)
    given = {name: joints[name] for name in EVALUATED_JOINTS[:12]}
    given["l_toe"] = np.array([50.0, 50, 50])
    given["head_top"] = np.array([np.nan, 0, 0])
    fitted, pose, error = fit_to_joints(SONG, given)
    reached = posed_joints(fitted, pose[None])[0]
    assert error < 0.004
    for name in ("neck", "l_knee", "r_wrist"):
        place = reached[SONG.joint_names.index(name)]
        assert np.linalg.norm(place - joints[name]) < 0.008, name
    joints["l_wrist"] = joints["l_wrist"] + [0, 0, 1.5]
    assert fit_to_joints(SONG, joints)[2] > 0.1
    with pytest.raises(InputError, match=r"7 known joints to start from .*expected at least 8"):
        fit_to_joints(SONG, {name: joints[name] for name in EVALUATED_JOINTS[:7]})
    with pytest.raises(InputError, match=r"0 known joints to start from .none"):
        fit_to_joints(SONG, {"toe": np.zeros(3)})


def test_pose_files(tmp_path: Path) -> None:
    path = tmp_path / "pose.txt"
    pose = bodies.random_poses(SONG, 1, wild=True)[0]
    path.write_text("\n".join(str(value) for value in pose))
    np.testing.assert_array_equal(read_pose(path, SONG), pose)
    write_pose(path, pose, SONG)
    np.testing.assert_allclose(read_pose(path, SONG), pose, rtol=1e-8)
