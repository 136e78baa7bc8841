"""bodytrack's own files: joints compared with the formulas of the shared sequence's README."""

from pathlib import Path

import numpy as np
import pytest
from helpers.shared import shared_data
from scipy.spatial.transform import Rotation

from apf.body.bodytrack import TRANSLATIONS, is_bodytrack, read_body, read_poses
from apf.body.kinematics import posed_cones, posed_joints
from apf.evaluation.joint_names import EVALUATED_JOINTS
from cl import InputError
from psfs.sequence import Sequence

H = np.pi / 2
SIDES = {"l": (1, 2, 3, 9, 10, 11, 6, 14), "r": (5, 6, 7, 13, 14, 15, 10, 20)}


def about(axis: str, angle: float) -> np.ndarray:
    return Rotation.from_euler(axis, angle).as_matrix()


def euler(x: float, y: float, z: float) -> np.ndarray:
    return about("z", z) @ about("x", x) @ about("y", y)


def formulas(a: np.ndarray, L: np.ndarray) -> dict[str, np.ndarray]:
    """Compute the joints, mm, of a pose a0..a30 (rad, mm) and lengths L0..L17, after the README."""
    o, P = a[3:6], euler(*a[:3])
    X = P @ about("x", np.pi) @ euler(0, a[26], a[27]).T
    neck = o + X @ [0, 0, -L[0]]
    head = X @ about("x", np.pi) @ euler(*a[28:31]).T
    joints = {"pelvis": o, "neck": neck, "head_top": neck + head @ [0, 0, L[17]]}
    for side, (hip, thigh, calf, clavicle, upper, fore, leg, arm) in SIDES.items():
        left = 1 if side == "l" else -1
        T = P @ about("y", np.pi) @ euler(*a[leg : leg + 3]).T
        joints[f"{side}_hip"] = o + P @ about("y", np.pi) @ [0, left * L[hip], 0]
        joints[f"{side}_knee"] = joints[f"{side}_hip"] + T @ [0, 0, L[thigh]]
        shin = T @ about("y", a[leg + 3]).T
        joints[f"{side}_ankle"] = joints[f"{side}_knee"] + shin @ [0, 0, L[calf]]
        C = X @ about("x", -left * H) @ euler(a[arm], a[arm + 1], 0).T
        joints[f"{side}_shoulder"] = neck + C @ [0, 0, -L[clavicle]]
        U = C @ about("x", -H) @ about("z", np.pi) @ about("y", -H)
        U = U @ euler(*a[arm + 2 : arm + 5]).T
        joints[f"{side}_elbow"] = joints[f"{side}_shoulder"] + U @ [0, 0, -L[upper]]
        forearm = U @ about("y", a[arm + 5]).T
        joints[f"{side}_wrist"] = joints[f"{side}_elbow"] + forearm @ [0, 0, -L[fore]]
    return joints


def write_files(folder: Path, seed: int = 0) -> dict[str, np.ndarray]:
    """Write random parameter files; return their numbers."""
    random = np.random.default_rng(seed)
    scales = random.uniform(0.5, 1.5, (10, 2))
    parts = np.concatenate([random.uniform(20, 200, (10, 2)), scales], 1)
    lengths = random.uniform(50, 600, 18)
    ranges = random.uniform(0.01, 1, (3, 31))
    poses = random.uniform(-2, 2, (4, 31))
    poses[:, 3:6] = random.uniform(-2000, 2000, (4, 3))
    for name, values in (
        ("BodyShapeParameters.txt", np.concatenate([parts.ravel(), lengths])),
        ("PoseParameters.txt", ranges),
        ("InitialPose.txt", poses[0]),
        ("poses.txt", poses),
    ):
        np.savetxt(folder / name, np.atleast_2d(values), fmt="%.15g")
    return {"parts": parts, "lengths": lengths, "sigma": ranges[0], "poses": poses}


def test_joints_follow_the_formulas(tmp_path: Path) -> None:
    truth = write_files(tmp_path)
    body, poses = read_body(tmp_path), read_poses(tmp_path / "poses.txt")
    for pose, joints in zip(truth["poses"], posed_joints(body, poses), strict=True):
        expected = formulas(pose, truth["lengths"])
        assert set(expected) == set(body.joint_names) == set(EVALUATED_JOINTS)
        for name, joint in zip(body.joint_names, joints, strict=True):
            np.testing.assert_allclose(joint * 1e3, expected[name], atol=1e-6, err_msg=name)


def test_parts_lie_between_the_joints_and_have_the_radii_of_the_file(tmp_path: Path) -> None:
    truth = write_files(tmp_path, 1)
    body, poses = read_body(tmp_path), read_poses(tmp_path / "poses.txt")
    cones = posed_cones(body, poses)
    ends = {"l_thigh": ("l_hip", "l_knee"), "r_thigh": ("r_hip", "r_knee")}
    ends |= {"l_calf": ("l_knee", "l_ankle"), "r_calf": ("r_knee", "r_ankle")}
    ends |= {"l_upper_arm": ("l_shoulder", "l_elbow"), "r_upper_arm": ("r_shoulder", "r_elbow")}
    ends |= {"l_forearm": ("l_elbow", "l_wrist"), "r_forearm": ("r_elbow", "r_wrist")}
    ends |= {"head": ("neck", "head_top")}
    for n, pose in enumerate(truth["poses"]):
        joints = formulas(pose, truth["lengths"])
        up = pose[3:6] + euler(*pose[:3]) @ [0, 0, truth["lengths"][0]]
        for c, name in enumerate(body.cone_names):
            # The torso's cylinder stands on the pelvis and ignores the thorax's angles.
            start, end = (pose[3:6], up) if name == "torso" else (joints[k] for k in ends[name])
            np.testing.assert_allclose(cones[n, c, 0:3] * 1e3, start, atol=1e-6, err_msg=name)
            np.testing.assert_allclose(cones[n, c, 4:7] * 1e3, end, atol=1e-6, err_msg=name)
    for c, part in enumerate(truth["parts"]):
        np.testing.assert_allclose(cones[0, c, [3, 7]] * 1e3, part[:2], err_msg=str(c))
        np.testing.assert_allclose(1 / np.linalg.norm(cones[0, c, 8:11]), part[2])
        np.testing.assert_allclose(1 / np.linalg.norm(cones[0, c, 12:15]), part[3])


def test_lengths_become_metres_and_limits_stay_open(tmp_path: Path) -> None:
    truth = write_files(tmp_path)
    body, poses = read_body(tmp_path), read_poses(tmp_path / "poses.txt")
    unit = np.where(np.isin(np.arange(31), [3, 4, 5]), 1e-3, 1.0)
    np.testing.assert_allclose(body.sigma, truth["sigma"] * unit)
    np.testing.assert_allclose(body.rest_pose, poses[0])
    assert np.isinf(body.lower).all() and np.isinf(body.upper).all()
    assert body.dof_names[TRANSLATIONS] == ("pelvis.tx", "pelvis.ty", "pelvis.tz")
    assert is_bodytrack(tmp_path) and not is_bodytrack(tmp_path / "elsewhere")


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("BodyShapeParameters.txt", 58),
        ("PoseParameters.txt", 93),
        ("InitialPose.txt", 31),
        ("poses.txt", 124),
    ],
)
def test_short_or_missing_files_are_refused(tmp_path: Path, name: str, count: int) -> None:
    write_files(tmp_path)
    path = tmp_path / name
    numbers = path.read_text().split()
    for text, said in (
        ("\n".join(numbers[:-1]), f"{count - 1} numbers; expected .*{31 if count > 93 else count}"),
        ("1.0 2.0 three", "expected numbers only"),
        ("", "0 numbers"),
        (None, "no such file"),
    ):
        path.unlink() if text is None else path.write_text(text)
        with pytest.raises(InputError, match=f"{name}: {said}"):
            read_poses(path) if name == "poses.txt" else read_body(tmp_path)


def test_the_real_persons_limbs_lie_on_the_pictures() -> None:
    """Axes of the parts at the peer's poses fall on the shipped foreground, in every picture."""
    folder = shared_data("bodytrack_walk")
    sequence = Sequence.open(folder)
    body = read_body(folder)
    cones = posed_cones(body, read_poses(folder / "reference_poses.txt"))
    t = np.linspace(0, 1, 20)[:, None, None]
    for index in range(len(sequence)):
        points = (cones[index, :, 0:3] * (1 - t) + cones[index, :, 4:7] * t).reshape(-1, 3)
        masks = sequence.read(index).masks
        assert masks is not None
        for camera, mask in zip(sequence.rig, masks, strict=True):
            column, row = np.rint(camera.project(points)[0]).astype(int).T
            assert (mask[row, column] > 0).mean() > 0.9, (index, camera.name)
