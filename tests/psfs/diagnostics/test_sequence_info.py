"""`psfs info`: facts and warnings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import footage, scenes
from helpers.commands import fail, succeed

from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import find_seen_box
from psfs.cameras.units import rotate_rig, rotation_to_z_up, scale_rig
from psfs.diagnostics.sequence_info import SequenceInfo, rig_warnings
from psfs.sequence import Sequence


def test_facts(tmp_path: Path) -> None:
    sequence = Sequence.open(footage.native(tmp_path, views=4))
    info = SequenceInfo(sequence)
    np.testing.assert_allclose(info.centre, [0, 0, 0.9], atol=0.05)
    assert info.extent == pytest.approx(6, abs=1e-6)
    assert info.distances == pytest.approx([np.hypot(3, 0.6)] * 4, abs=0.05)
    assert info.warnings == [] and sequence.notes == []
    low, high = info.shared
    assert (low < [-0.3, -0.3, 0.7]).all() and (high > [0.3, 0.3, 1.1]).all()


def test_warnings_of_a_wrong_rig() -> None:
    rig = footage.rig(4)
    assert any("millimetres read as metres" in w for w in rig_warnings(scale_rig(rig, 1000)))
    assert any("metres read as milli" in w for w in rig_warnings(scale_rig(rig, 0.001)))
    assert any("up axis" in w for w in rig_warnings(rotate_rig(rig, rotation_to_z_up("-z"))))
    one = CameraRig(tuple(replace(camera, t=np.zeros(3)) for camera in rig))
    assert "stand at one place" in rig_warnings(one)[0]
    away = scenes.looking_at("lost", np.array([3, 0, 1.5]), np.array([9, 0, 1]), footage.SIZE, 60.0)
    assert rig_warnings(CameraRig((*rig, away))) == [
        "camera lost sees nothing of the volume the others share"
    ]


def test_two_cameras_that_look_apart() -> None:
    centre = np.array([0.0, 0.0, 1.0])
    aside = np.array([0.2, 0.0, 0.0])
    left = scenes.looking_at("left", centre - aside, np.array([-9, 0, 1]), (64, 48), 60.0)
    right = scenes.looking_at("right", centre + aside, np.array([9, 0, 1]), (64, 48), 60.0)
    rig = CameraRig((left, right))
    assert find_seen_box(rig, 2) is None
    assert any("no point is seen by two" in warning for warning in rig_warnings(rig))


@pytest.mark.parametrize(
    "name",
    [
        "keypoints.npz",
        "pose/cam01_json/cam01_000000.json",
        "output_data/raw_data/mediapipe_2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy",
        "Videos/Cam0/OutputPkl_default/jump/jump_rotated_pp.pkl",
        "cam01DLC_resnet50_100000.csv",
    ],
)
def test_keypoints_are_noticed_and_not_read(tmp_path: Path, name: str) -> None:
    folder = footage.native(tmp_path / "walk")
    assert SequenceInfo(Sequence.open(folder)).keypoints is None
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text("nothing that could be read")
    said = succeed("psfs", "info", folder, "--no-pictures").out
    assert "note: keypoints of a pose network" in said


def test_command(tmp_path: Path) -> None:
    folder = footage.native(tmp_path / "walk[1]")
    captured = succeed("psfs", "info", folder, "--up", "-z", "--volume", "-1,1,-1,1,0,2")
    assert "cam03" in captured.out and "64 x 48" in captured.out and "walk[1]" in captured.out
    assert "warning: all cameras lie below z = 0" in captured.out
    assert "(-1.00, -1.00, 0.00) to (1.00, 1.00, 2.00) m" in captured.out
    assert captured.err == ""
    fail("psfs", "info", folder, "--volume", "1,2,3")
