"""Body models: shipped ones, the TOML reader and writer, scaling."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from helpers import bodies

from apf.body.kinematics import bone_matrices, posed_joints
from apf.body.limbs import trunk_mask
from apf.body.model import sideless
from apf.body.toml import load_body, save_body
from cl import InputError

SONG = load_body("song31")


def moved(**dofs: float) -> dict[str, np.ndarray]:
    """Return the displacement (3,) m of each joint of song31 for these degrees of freedom (. as
    __)."""
    step = posed_joints(SONG, np.stack([SONG.rest_pose, bodies.bent(SONG, **dofs)]))
    return dict(zip(SONG.joint_names, step[1] - step[0], strict=True))


def test_limbs_and_trunks_bend_the_way_a_person_does() -> None:
    """Those of the left; the other side mirrors them, see below."""
    assert moved(l_forearm__ry=1.0)["l_wrist"][0] > 0.1  # the elbow bends forward
    assert moved(l_calf__ry=1.0)["l_ankle"][0] < -0.1  # the knee backward
    assert moved(l_thigh__ry=0.5)["l_knee"][0] > 0.1  # a positive hip swings forward
    assert moved(l_upper_arm__ry=0.5)["l_elbow"][0] > 0.1
    assert moved(l_thigh__rx=0.5)["l_knee"][1] > 0.1  # and spreads outward
    assert moved(l_upper_arm__rx=0.5)["l_elbow"][1] > 0.1
    assert moved(thorax__ry=0.5)["neck"][0] > 0.1
    assert moved(head__ry=0.5)["head_top"][0] > 0.05
    body = load_body("song32")
    assert set(body.dof_names) - set(SONG.dof_names) == {"thorax.rx"}
    positions = posed_joints(body, bodies.bent(body, thorax__rx=0.3)[None])[0]
    joints = dict(zip(body.joint_names, positions, strict=True))
    assert joints["neck"][1] < -0.1  # to the right
    assert joints["l_hip"][2] == joints["r_hip"][2]
    assert trunk_mask(body)[body.dof_names.index("thorax.rx")]


def test_song31_is_symmetric() -> None:
    """A mirrored pose gives mirrored joints: the signs of left and right fit each other."""
    poses = bodies.random_poses(SONG, 20, wild=True)
    mirrored = poses.copy()
    for place, name in enumerate(SONG.dof_names):
        bone, kind = name.split(".")
        if bone[:2] in ("l_", "r_"):
            other = ("r_" if bone[0] == "l" else "l_") + bone[2:]
            mirrored[:, SONG.dof_names.index(f"{other}.{kind}")] = poses[:, place]
        elif kind in ("ty", "rx", "rz"):
            mirrored[:, place] = -poses[:, place]
    swap = {"l": "r", "r": "l"}
    partner = [
        SONG.joint_names.index(swap[n[0]] + n[1:] if n[1] == "_" else n) for n in SONG.joint_names
    ]
    expected = posed_joints(SONG, poses)[:, partner] * [1, -1, 1]
    np.testing.assert_allclose(posed_joints(SONG, mirrored), expected, atol=1e-12)


def test_stick_is_read_as_written() -> None:
    stick = bodies.named("stick")
    assert stick.dof_names == ("bend", "l_lower.rz", "upper.rx", "l_lower.tx", "l_lower.ty")
    np.testing.assert_array_equal(stick.sigma, [0.05, 0.02, 0.03, 0.01, 0.0])
    assert np.isinf(stick.posture_sigma).all()
    np.testing.assert_array_equal(stick.lower, [-0.1, -np.inf, -2, -0.5, -np.inf])
    np.testing.assert_array_equal(stick.upper, [0.2, np.inf, 2, 0.5, np.inf])
    np.testing.assert_array_equal(stick.rest_pose, [0, 0, 0.3, 0, 0.05])
    assert [bone.parent for bone in stick.bones] == [-1, 0, -1]
    assert [axis.sign for bone in stick.bones for axis in bone.axes] == [-1, 1, 1, -1, 1]
    assert stick.edges == ((0, 1),) and stick.apart == ((0, 2), (2, 1))
    for cone in stick.cones:
        assert np.linalg.norm(cone.side) == pytest.approx(1)
        assert cone.side @ (cone.end - cone.start) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("name", ["song31", "stick"])
def test_saved_bodies_come_back(name: str, tmp_path: Path) -> None:
    body = bodies.named(name)
    for saved in (body, body.scaled(dict.fromkeys(body.scale_groups, 1.1), radii=1.07)):
        save_body(tmp_path / "copy.toml", saved)
        again = asdict(load_body(tmp_path / "copy.toml"))
        for cone, old in zip(again["cones"], saved.cones, strict=True):
            np.testing.assert_allclose(cone["side"], old.side, atol=1e-15)
            cone["side"] = old.side
        np.testing.assert_equal(again, asdict(saved))


BAD = {
    "unknown parent": ('parent = "l_lower"', 'parent = "nobody"', "nobody"),
    "unknown axis": ('axis = "rx"', 'axis = "rw"', "rw"),
    "empty axis": ('axis = "rx"', 'axis = ""', "axis"),
    "index left out": ("dof = 4", "dof = 5", "indices"),
    "limit not a number": ("limits = [-0.1, 0.2]", "limits = [nan, 0.2]", "bend"),
    "sigma not a number": ("sigma = 0.05", "sigma = nan", "sigma"),
    "no posture": ("sigma = 0.05", "sigma = 0.05, posture_sigma = 0.0", "posture_sigma"),
    "nothing to rise with": ("sigma = 0.05", "sigma = 0.05, posture_rise = 0.1", "bend"),
    "turned by no rotation": ("[0.0, 0.8, 0.6]]", "[0.0, 0.8, 0.7]]", "rotation"),
    "a mirror": ("[0.0, 0.8, 0.6]]", "[0.0, -0.8, -0.6]]", "rotation"),
    "two numbers for a point": ("offset = [0.0, 0.0, 0.05]", "offset = [0.0, 0.05]", "3 numbers"),
    "infinite offset": ("offset = [0.0, 0.0, 0.05]", "offset = [0.0, 0.0, inf]", "finite"),
    "flat cone": ("scale = [1.4, 0.6]", "scale = [1.4, 0.0]", "lower"),
    "side along the axis": ("side = [0.3, 1.0, 0.2]", "side = [0.02, 0.03, 0.6]", "lower"),
    "cone of no bone": ('bone = "ground"', 'bone = "sky"', "sky"),
    "edge to no joint": ('["base", "tip"]', '["base", "top"]', "top"),
    "apart from no cone": ('["post", "upper"]', '["post", "uppr"]', "uppr"),
    "not TOML": ('name = "stick"', "name = stick", "TOML"),
}


@pytest.mark.parametrize("change", BAD.values(), ids=BAD.keys())
def test_wrong_entries_are_named(change: tuple[str, str, str], tmp_path: Path) -> None:
    old, new, said = change
    assert old in bodies.STICK
    path = tmp_path / "odd.toml"
    path.write_text(bodies.STICK.replace(old, new))
    with pytest.raises(InputError) as caught:
        load_body(path)
    message = str(caught.value)
    assert message.startswith(str(path)) and said in message and "\n" not in message
    assert message.count(str(path)) == 1


@pytest.mark.parametrize(
    ("group", "segments"),
    [
        ("forearm", ["elbow-wrist"]),
        ("upper_arm", ["shoulder-elbow"]),
        ("thigh", ["hip-knee"]),
        ("calf", ["knee-ankle"]),
    ],
)
def test_scaling_changes_exactly_what_is_fixed_to_the_bone(group: str, segments: list) -> None:
    poses = bodies.random_poses(SONG, 5, wild=True)
    body = SONG.scaled({group: 1.3})
    before, after = posed_joints(SONG, poses), posed_joints(body, poses)
    for a, b in SONG.edges:
        names = [sideless(SONG.joint_names[i]) for i in (a, b)]
        factor = 1.3 if "-".join(names) in segments else 1.0
        length = [
            np.linalg.norm(joints[:, a] - joints[:, b], axis=-1) for joints in (before, after)
        ]
        np.testing.assert_allclose(length[1], factor * length[0], rtol=1e-12)
    for cone, old in zip(body.cones, SONG.cones, strict=True):
        ours = body.bones[cone.bone].name.endswith(group)
        np.testing.assert_allclose(cone.end, old.end * (1.3 if ours else 1.0))
        assert cone.radii == old.radii


def test_scaling_all_bones_scales_the_body() -> None:
    body = SONG.scaled(dict.fromkeys(SONG.scale_groups, 0.8), radii=0.7)
    poses = bodies.random_poses(SONG, 5, wild=True)
    (_, pelvis), (_, scaled_pelvis) = bone_matrices(SONG, poses), bone_matrices(body, poses)
    np.testing.assert_allclose(scaled_pelvis[:, 0], pelvis[:, 0])  # stays where the pose puts it
    expected = (posed_joints(SONG, poses) - pelvis[:, :1]) * 0.8 + pelvis[:, :1]
    np.testing.assert_allclose(posed_joints(body, poses), expected, atol=1e-12)
    for cone, old in zip(body.cones, SONG.cones, strict=True):
        np.testing.assert_allclose(cone.radii, np.multiply(old.radii, 0.7))
