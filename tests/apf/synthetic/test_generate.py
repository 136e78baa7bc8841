"""The synthetic walker: a believable body, exact truth, whole folders."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from apf.body.kinematics import posed_joints
from apf.body.toml import load_body
from apf.formats.pose import read_pose
from apf.reference.synthetic.scene import body_distance
from apf.synthetic.body import PersonSurface
from apf.synthetic.gait import GaitModel
from apf.synthetic.generate import BACKGROUND_FRAMES, generate
from apf.synthetic.render import SyntheticScene
from apf.synthetic.scene import SceneConfig, make_rig
from apf.synthetic.walk import Walk
from cl import Device, InputError
from psfs.output.video import count_frames

SMALL = SceneConfig(cameras=2, frames=12, size=(160, 120), seed=3)
LIMBS = [
    (f"{side}_{a}", f"{side}_{b}")
    for side in "lr"
    for a, b in (("shoulder", "elbow"), ("elbow", "wrist"), ("wrist", "hand"), ("hip", "knee"),
                 ("knee", "ankle"), ("ankle", "toe"), ("toe", "toe_tip"))
] + [("head", "head_top"), ("l_hip", "r_hip"), ("thorax", "neck")]  # fmt: skip


@pytest.fixture(scope="module")
def scene(device: Device) -> SyntheticScene:
    return SyntheticScene(SMALL, device)


@pytest.fixture(scope="module")
def folder(device: Device, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("synthetic") / "walk"
    generate(path, SMALL, device)
    return path


@pytest.mark.parametrize("course", ["straight", "diagonal"])
def test_a_straight_walk_goes_to_a_camera_or_between_two(course: str) -> None:
    config = SceneConfig(cameras=4, seed=5, course=course)  # type: ignore[arg-type]
    gait = GaitModel(config.walk)
    joints = gait.skeleton.joints(gait.motion(np.arange(0.0, 3.0, 0.02)))
    trail = joints[:, gait.skeleton.joint_names.index("pelvis"), :2]
    ahead = (trail[-1] - trail[0]) / np.linalg.norm(trail[-1] - trail[0])
    aside = (trail - trail[0]) @ [-ahead[1], ahead[0]]
    assert np.abs(aside).max() < 0.06 and np.linalg.norm(trail[-1] - trail[0]) > 3
    bearings = [camera.centre / np.linalg.norm(camera.centre[:2]) for camera in make_rig(config)]
    nearest = np.degrees(np.arccos(max(ahead @ bearing[:2] for bearing in bearings)))
    assert nearest < 10 if course == "straight" else nearest > 30


def walked(seed: int) -> dict[str, np.ndarray]:
    gait = GaitModel(Walk.sample(seed, 1.76))
    joints = gait.skeleton.joints(gait.motion(np.arange(0.0, 3.0, 1 / 120)))
    return {name: joints[:, i] for i, name in enumerate(gait.skeleton.joint_names)}


@pytest.mark.parametrize("seed", range(4))
def test_bones_keep_their_length_and_feet_stand_still_on_the_floor(seed: int) -> None:
    """Feet are never below it."""
    joints = walked(seed)
    for a, b in LIMBS:
        length = np.linalg.norm(joints[a] - joints[b], axis=1)
        assert np.ptp(length) < 1e-9, (a, b)
    for side in "lr":
        ankle, toe = joints[f"{side}_ankle"], joints[f"{side}_toe"]
        assert ankle[:, 2].min() > 0.07
        assert joints[f"{side}_toe_tip"][:, 2].min() > 0.01
        down = toe[:, 2] < 0.015 * 1.76 + 1e-9  # the ball bears weight
        assert 0.35 < down.mean() < 0.7
        step = np.linalg.norm(np.diff(toe, axis=0), axis=1)[down[1:] & down[:-1]]
        assert step.max() < 1e-6


@pytest.mark.parametrize("seed", range(4))
def test_the_walk_is_a_walk(seed: int) -> None:
    joints = walked(seed)
    u, v = (joints[f"l_{b}"] - joints[f"l_{a}"] for a, b in (("hip", "knee"), ("knee", "ankle")))
    lengths = np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
    knee = np.degrees(np.arccos((u * v).sum(1) / lengths))
    assert knee.min() > 5 and 45 < knee.max() < 75
    heights = joints["head_top"][:, 2]
    assert heights.min() > 1.66 and heights.max() < 1.78
    assert 0.02 < np.ptp(joints["pelvis"][:, 2]) < 0.07
    for name, path in joints.items():
        jerkiness = np.abs(np.diff(path, 2, axis=0)).max() * 120**2
        assert jerkiness < 150, name  # m/s^2: no teleporting joint; feet land with a jolt
    assert np.abs(joints["pelvis"][:, :2]).max() < 2.0


def test_flesh_surrounds_the_joints_and_stays_above_the_floor() -> None:
    gait = GaitModel(Walk.sample(5, 1.76))
    motion = gait.motion(np.arange(0.0, 1.1, 0.1))
    flesh = PersonSurface(gait.skeleton)
    joints = gait.skeleton.joints(motion)
    for frame in range(len(joints)):
        primitives = flesh.packed(motion, frame)
        assert (body_distance(primitives, joints[frame]) < 0.005).all()
        x, y = np.meshgrid(np.arange(-0.7, 0.7, 0.02), np.arange(-0.7, 0.7, 0.02))
        under = np.stack([x.ravel(), y.ravel(), np.full(x.size, -0.012)], -1)
        under[:, :2] += joints[frame, 0, :2]
        assert (body_distance(primitives, under) > 0).all()


def test_frames_repeat_and_noise_is_as_asked(device: Device, scene: SyntheticScene) -> None:
    again = SyntheticScene(SMALL, device)
    again.frame(0)
    for a, b in zip(scene.frame(7), again.frame(7), strict=True):
        np.testing.assert_array_equal(a, b)
    stack = np.stack([scene.background_frame(i) for i in range(20)]).astype(np.float64)
    level = stack.mean(axis=(2, 3, 4), keepdims=True)
    assert abs((stack / level * level.mean(0)).std(0).mean() - SMALL.noise) < 0.4
    assert 0.002 < (level.std(0) / level.mean(0)).mean() < 0.02
    assert not np.array_equal(stack[0], stack[1])


def test_folder_is_whole(folder: Path, scene: SyntheticScene) -> None:
    for kind, frames in (("videos", SMALL.frames), ("background", BACKGROUND_FRAMES)):
        for camera in scene.rig:
            assert count_frames(folder / kind / f"{camera.name}.mp4") == frames
    truth = np.load(folder / "truth.npz")
    assert list(truth["joint_names"]) == scene.joint_names
    np.testing.assert_array_equal(truth["joints"], scene.people_joints[0])
    assert truth["fps"] == SMALL.fps
    rows = (folder / "truth.trc").read_text().splitlines()[6:]
    first = np.array(rows[0].split("\t")[2:], float).reshape(-1, 3) / 1000
    expected = scene.people_joints[0, 0][:, [0, 2, 1]] * [1, 1, -1]
    np.testing.assert_allclose(first, expected, atol=1e-6)
    assert len(rows) == SMALL.frames
    mask = cv2.imread(str(folder / "truth_masks" / "cam02_000010.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(mask > 0, scene.frame(10)[1][1] > 0)


def test_generate_replaces_its_own_files(device: Device, tmp_path: Path) -> None:
    shorter = SceneConfig(cameras=1, frames=1, size=(64, 48))
    generate(tmp_path, shorter.replace(cameras=2), device)
    generate(tmp_path, shorter, device)
    assert not (tmp_path / "videos" / "cam02.mp4").exists()


def test_any_body_is_filmed(device: Device, tmp_path: Path) -> None:
    config = SceneConfig(cameras=2, frames=2, size=(160, 120), body="dog")
    generate(tmp_path / "dog", config, device)
    body = load_body(tmp_path / "dog" / "body.toml")
    truth = np.load(tmp_path / "dog" / "truth.npz")
    pose = read_pose(tmp_path / "dog" / "start.txt", body)
    np.testing.assert_allclose(posed_joints(body, pose[None])[0], truth["joints"][0], atol=1e-5)
    scene = SyntheticScene(config, device)
    _, shown = scene.frame(0)
    for camera, mask in zip(scene.rig, shown, strict=True):
        inside, rows, columns, _ = camera.look_up(truth["joints"][0])
        assert inside.all() and (mask[rows, columns] > 0).mean() > 0.8
    with pytest.raises(InputError, match="expected 1 with a body"):
        SceneConfig(body="dog", people=2)
