"""measure_angles.py: the errors of a track whose truth is known, and its tables."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.shared import ROOT
from helpers.striders import strider

from apf.body.kinematics import bone_matrices, posed_joints
from apf.body.model import BodyModel
from apf.tracking.smoothing import smooth_track

sys.path.insert(0, str(ROOT / "scripts"))
from measure_angles import (
    joint_table,
    measure_shoulders,
    measure_track,
    read_mot,
    sequence_table,
)

#: Bones of the truth by the body's own names, as `apf synth` writes them.
_BONES = {"calf": "shin"}


def _write_truth(path: Path, body: BodyModel, poses: np.ndarray) -> None:
    upright, _ = bone_matrices(body, np.zeros((1, body.n_dof)))
    rotations, _ = bone_matrices(body, poses)
    names = [bone.name for bone in body.bones]
    for old, new in _BONES.items():
        names = [name.replace(old, new) for name in names]
    from_rest = np.einsum("fbij,bkj->fbik", rotations, upright[0])
    np.savez(
        path, joint_names=np.array(body.joint_names), joints=posed_joints(body, poses), fps=30.0,
        bone_names=np.array(names), bone_rotations=from_rest,
    )  # fmt: skip


def test_angles_of_a_known_track(tmp_path: Path) -> None:
    """A truth that is the track itself has no error; one whose pelvis and all with it is turned by
    5 degrees about the vertical has 5 degrees of pelvis_rotation, and none between segments."""
    track = strider(30)
    track.save(tmp_path / "a.npz")
    smooth = smooth_track(track)
    body = smooth.its_body
    _write_truth(tmp_path / "truth.npz", body, smooth.poses)
    given = argparse.Namespace(opensim=None, osim_model=None)
    found = measure_track(tmp_path / "a.npz", tmp_path / "truth.npz", given)["ours"]
    assert {"hip_flexion_l", "knee_angle_r", "pelvis_rotation", "arm_flex_l"} <= set(found)
    assert max(free for _, free in found.values()) < 0.1

    turned = smooth.poses.copy()
    turned[:, body.dof_names.index("pelvis.rz")] += np.radians(5)
    _write_truth(tmp_path / "turned.npz", body, turned)
    off = measure_track(tmp_path / "a.npz", tmp_path / "turned.npz", given)["ours"]
    assert off["pelvis_rotation"] == [pytest.approx(5, abs=0.2), pytest.approx(0, abs=0.1)]
    assert off["knee_angle_r"] == pytest.approx(found["knee_angle_r"], abs=0.1)


def test_shoulders_as_biomechanists_report_them() -> None:
    """An upper arm that is turned about itself by 20 degrees has its direction, elevation and plane
    right, and an axial rotation that counts only where the elbow is bent; one that is raised by 5
    degrees more along its plane has that elevation, and that direction but for an offset."""
    straight, bent = np.zeros(4), np.full(4, 50.0)
    true = {"arm_flex_r": np.linspace(40, 80, 4), "arm_add_r": straight, "arm_rot_r": bent}
    turned = true | {"arm_rot_r": bent + 20}
    nothing = pytest.approx([0, 0], abs=1e-3)
    for elbow, axial in ((straight, {}), (bent, {"axial_r": pytest.approx([20, 0], abs=1e-3)})):
        given = {"elbow_flex_r": elbow}
        found = measure_shoulders(turned | given, true | given)
        others = dict.fromkeys(("plane_r", "elevation_r", "direction_r"), nothing)
        assert found == others | axial
    given = {"elbow_flex_r": bent}
    raised = true | {"arm_flex_r": true["arm_flex_r"] + 5}
    found = measure_shoulders(raised | given, true | given)
    assert found["elevation_r"] == found["direction_r"] == pytest.approx([5, 0], abs=1e-3)


def test_tables(tmp_path: Path) -> None:
    """Means over sides and sequences; what OpenSim was not asked for is left blank."""
    rows = [
        {"sequence": "a", "by": "voxels", "ours": {"knee_angle_l": [4, 2], "knee_angle_r": [2, 0]}},
        {"sequence": "b", "by": "voxels", "ours": {"knee_angle_l": [6, 4], "elevation_r": [1, 0]}},
    ]
    results = {"tracks": rows, "device": "a device", "made": "today", "commit": "1"}
    joints = joint_table(results).markdown()
    assert "| knee | 4.0 / 2.0 | - |" in joints and "voxels 2;" in joints
    assert "| shoulder: elevation | 1.0 / 0.0 | - |" in joints
    assert "| a | 3.0 / 1.0; 3.0 / 1.0 | -; - |" in sequence_table(results).markdown()
    mot = tmp_path / "a.mot"
    mot.write_text("Coordinates\nendheader\ntime\tknee\n0.0\t1.5\n0.1\t2.5\n")
    np.testing.assert_array_equal(read_mot(mot)["knee"], [1.5, 2.5])
