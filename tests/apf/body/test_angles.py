"""Clinical angles: signs, conventions, and joints that a body lacks."""

import numpy as np
import pytest
from helpers import bodies
from scipy.spatial.transform import Rotation

from apf.body.angles import HANGING, anatomical_frames, joint_angles, relative_rotations
from apf.body.markers import virtual_markers
from apf.body.model import BodyModel
from apf.body.toml import load_body
from apf.formats.angles import opensim_coordinates

SONG = load_body("song31")


def pose_of(body: BodyModel = SONG, **degrees: float) -> np.ndarray:
    """Return a pose (1, D) with all angles at 0 except the given ones, such as `l_thigh_ry=30`."""
    pose = np.zeros((1, body.n_dof))
    for name, value in degrees.items():
        pose[0, body.dof_names.index(".".join(name.rsplit("_", 1)))] = np.radians(value)
    return pose


@pytest.mark.parametrize("body", ["song31", "rymut31"])
@pytest.mark.parametrize("side", ["l", "r"])
def test_names_and_signs(body: str, side: str) -> None:
    """Free axes of both sides are defined so that positive is forward, outward, outward."""
    model = load_body(body)
    for dof, value, name, expected in (
        ("thigh_ry", 30, "hip_flexion", 30),
        ("thigh_rx", 20, "hip_adduction", -20),
        ("thigh_rz", 15, "hip_rotation", -15),
        ("calf_ry", 70, "knee_flexion", 70),
        ("upper_arm_rx", 80, "shoulder_elevation", 80),
        ("upper_arm_rx", 80, "shoulder_plane_of_elevation", 0),
        ("upper_arm_rx", 80, "shoulder_adduction", -80),
        ("upper_arm_ry", 60, "shoulder_plane_of_elevation", 90),
        ("upper_arm_ry", 60, "shoulder_flexion", 60),
        ("upper_arm_rz", 40, "shoulder_rotation", -40),
        ("forearm_ry", 100, "elbow_flexion", 100),
    ):
        angles = joint_angles(model, pose_of(model, **{f"{side}_{dof}": value}))
        assert angles[f"{side}_{name}"][0] == pytest.approx(expected, abs=1e-6), (dof, name)


def test_trunk_and_pelvis() -> None:
    for dof, name in (
        ("pelvis_rz", "pelvis_rotation"),
        ("pelvis_rx", "pelvis_obliquity"),
        ("pelvis_ry", "pelvis_anterior_tilt"),
        ("thorax_ry", "trunk_flexion"),
        ("thorax_rz", "trunk_left_rotation"),
        ("head_rx", "neck_right_bending"),
    ):
        angles = joint_angles(SONG, pose_of(**{dof: 12}))
        assert angles[name][0] == pytest.approx(12), name
        assert sum(abs(values[0]) > 1e-6 for values in angles.values()) == 1


@pytest.mark.parametrize(
    ("dof", "name", "of_opensim"),
    [
        ("pelvis_rz", "pelvis_rotation", "pelvis_rotation"),
        ("l_upper_arm_ry", "l_shoulder_flexion", "arm_flex_l"),
        ("r_upper_arm_rz", "r_shoulder_rotation", "arm_rot_r"),
    ],
)
def test_angles_do_not_jump_by_whole_turns(dof: str, name: str, of_opensim: str) -> None:
    turns = np.linspace(5, 720, 50)
    poses = np.concatenate([pose_of(**{dof: turn}) for turn in turns])
    sign = -1 if dof.endswith("arm_rz") else 1
    np.testing.assert_allclose(joint_angles(SONG, poses)[name], sign * turns, atol=1e-6)
    np.testing.assert_allclose(
        opensim_coordinates(SONG, poses)[of_opensim], sign * turns, atol=1e-6
    )


def test_shoulders_as_another_library_decomposes_them() -> None:
    poses = bodies.random_poses(SONG, 60, wild=True)
    frames, angles = anatomical_frames(SONG, poses), joint_angles(SONG, poses)
    for side in "lr":
        turned = relative_rotations(frames, "thorax", f"{side}_upper_arm")
        plane, elevation, axial = (
            angles[f"{side}_shoulder_{name}"]
            for name in ("plane_of_elevation", "elevation", "axial_rotation")
        )
        known = np.isfinite(plane)
        again = Rotation.from_euler("YXY", np.stack([plane, -elevation, axial], -1)[known], True)
        np.testing.assert_allclose(again.as_matrix(), turned[known], atol=1e-9)
        assert (elevation >= 0).all() and known.sum() > 55
        flexed = Rotation.from_matrix(turned).as_euler("ZXY", degrees=True)
        off = angles[f"{side}_shoulder_flexion"] - flexed[:, 0]  # whole turns
        np.testing.assert_allclose(off, 360 * np.round(off / 360), atol=1e-6)


def test_a_hanging_arm_has_no_plane_of_elevation() -> None:
    for elevation, known in ((0.5 * HANGING, False), (2 * HANGING, True)):
        angles = joint_angles(SONG, pose_of(r_upper_arm_rx=elevation))
        assert angles["r_shoulder_elevation"][0] == pytest.approx(elevation, abs=1e-6)
        assert np.isfinite(angles["r_shoulder_plane_of_elevation"][0]) == known
        assert np.isfinite(angles["r_shoulder_axial_rotation"][0]) == known


FOOT = """
[[bone]]
name = "{side}_foot"
parent = "{side}_calf"
offset = [0.0, 0.0, -0.433]
axes = [{{ axis = "-ry", sigma = 0.02 }}, {{ axis = "rx", sigma = 0.02 }}]
"""


def test_a_body_whose_feet_bend_has_ankles() -> None:
    from apf.body.toml import format_body

    text = format_body(SONG).split("[[cone]]", 1)
    feet = "".join(FOOT.format(side=side) for side in "lr")
    body = bodies.from_text(f"{text[0]}{feet}\n[[cone]]{text[1]}")
    angles = joint_angles(body, pose_of(body, l_foot_ry=10, r_foot_rx=5))
    assert angles["l_ankle_dorsiflexion"][0] == pytest.approx(10)
    assert angles["r_ankle_inversion"][0] == pytest.approx(5)


def test_markers_are_where_shoes_and_hands_end() -> None:
    markers = {marker.name: marker for marker in virtual_markers(SONG)}
    assert set(markers) == {f"{s}_{m}" for s in "lr" for m in ("heel", "toe", "hand")}
    calf = [bone.name for bone in SONG.bones].index("l_calf")
    assert markers["l_heel"].bone == markers["l_toe"].bone == calf
    length = np.linalg.norm(markers["l_toe"].position - markers["l_heel"].position)
    assert 0.25 < length < 0.32
    taller = {m.name: m for m in virtual_markers(SONG.scaled({"forearm": 1.1}))}
    assert taller["r_hand"].position[2] == pytest.approx(1.1 * markers["r_hand"].position[2])
    rymut = {marker.name: marker for marker in virtual_markers(load_body("rymut31"))}
    assert rymut["l_hand"].position[2] == pytest.approx(-0.43)  # of the hand, not the forearm
