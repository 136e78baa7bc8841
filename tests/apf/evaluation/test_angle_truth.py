"""Joint angles against the rotations of a rig with another rest pose, which turns with the body."""

from pathlib import Path

import numpy as np
import pytest
from helpers import bodies
from helpers.striders import track_of_poses
from scipy.spatial.transform import Rotation

from apf.body.angles import anatomical_frames
from apf.body.kinematics import posed_joints
from apf.body.toml import load_body
from apf.cli.evaluate import print_angles
from apf.evaluation.angle_truth import (
    AngleError,
    evaluate_angles,
    mean_error,
    summarise_angles,
)
from cl import InputError

SONG = load_body("song31")
#: A rig's names of the segments' bones.
BONES = {"pelvis": "Hips", "thorax": "Spine1", "head": "Head"} | {
    f"{side}_{segment}": f"{word}{bone}"
    for side, word in (("l", "Left"), ("r", "Right"))
    for segment, bone in (
        ("thigh", "UpLeg"), ("shank", "Leg"), ("upper_arm", "Arm"), ("forearm", "ForeArm")
    )
}  # fmt: skip


def rig_rest() -> np.ndarray:
    """The rig's rest pose: upright, facing -y, elbows bent and arms held out."""
    bend = {"pelvis__rz": -np.pi / 2, "l_forearm__ry": 0.7, "r_forearm__ry": 0.7}
    return bodies.bent(SONG, np.zeros((1, SONG.n_dof)), **bend)


@pytest.fixture
def truth(tmp_path: Path) -> tuple[Path, np.ndarray]:
    """A file of the rotations of a moving body, and its poses."""
    poses = 0.3 * bodies.random_poses(SONG, 12)
    rest = anatomical_frames(SONG, rig_rest())
    frames = anatomical_frames(SONG, poses)
    rotations = np.stack([frames[name] @ rest[name][0].T for name in BONES], 1)
    np.savez(
        tmp_path / "truth.npz", fps=30.0, joints=posed_joints(SONG, poses),
        joint_names=np.array(SONG.joint_names), bone_names=np.array(list(BONES.values())),
        bone_rotations=rotations,
    )  # fmt: skip
    return tmp_path / "truth.npz", poses


def errors_of(path: Path, poses: np.ndarray) -> dict[str, AngleError]:
    """Return the errors of a track of these poses, by the angles' names."""
    track = track_of_poses(SONG, poses, 30.0)
    return {error.name: error for error in evaluate_angles(track, path)}


def test_the_same_motion_has_the_same_angles(truth: tuple[Path, np.ndarray]) -> None:
    """Shoulders and elbows also of a rig whose forearms are turned aside at rest, as in an A pose
    with the palms down."""
    path, poses = truth
    errors = errors_of(path, poses)
    assert {"l_knee_flexion", "r_hip_flexion", "trunk_flexion", "l_elbow_flexion"} <= set(errors)
    legs = [e for n, e in errors.items() if "knee" in n or "hip" in n or "pelvis" in n]
    assert max(error.rms for error in legs) < 0.1
    assert max(error.free for error in errors.values() if error.defined) < 0.5
    with np.load(path) as stored:
        data = dict(stored)
    aside = Rotation.from_euler("xyz", [40, 30, 20], degrees=True).as_matrix()
    fore = [list(BONES).index(f"{side}_forearm") for side in "lr"]
    data["bone_rotations"][:, fore] = data["bone_rotations"][:, fore] @ aside.T
    np.savez(path, **data)
    errors = errors_of(path, poses)
    assert errors["l_shoulder_rotation"].free < 0.5 and errors["r_elbow_flexion"].free < 0.5


def test_a_bent_knee(truth: tuple[Path, np.ndarray], capsys: pytest.CaptureFixture[str]) -> None:
    path, poses = truth
    bend = np.radians(10.0) * (np.arange(len(poses)) % 2)
    errors = errors_of(path, bodies.bent(SONG, poses, l_calf__ry=bend))
    assert errors["l_knee_flexion"].rms == pytest.approx(10 / np.sqrt(2), abs=0.1)
    assert errors["l_knee_flexion"].free == pytest.approx(5.0, abs=0.1)
    found = list(errors.values())
    assert summarise_angles(found)["angle_rms_deg"] == pytest.approx(mean_error(found)[0], abs=1e-3)
    print_angles(found)
    assert "l_knee_flexion" in capsys.readouterr().out


def test_a_truth_without_rotations_or_with_broken_ones(tmp_path: Path) -> None:
    given = {"joint_names": np.array(["l_hip"]), "joints": np.zeros((2, 1, 3)), "fps": 30.0}
    np.savez(tmp_path / "plain.npz", **given)
    poses = 0.3 * bodies.random_poses(SONG, 2)
    assert errors_of(tmp_path / "plain.npz", poses) == {}
    assert errors_of(tmp_path / "truth.trc", poses) == {}
    wide = {"bone_names": np.array(["Hips"]), "bone_rotations": np.full((2, 1, 3, 3), 7.0)}
    np.savez(tmp_path / "wide.npz", **given, **wide)
    with pytest.raises(InputError, match="bone_rotations"):
        errors_of(tmp_path / "wide.npz", poses)
    assert summarise_angles([]) == {}
