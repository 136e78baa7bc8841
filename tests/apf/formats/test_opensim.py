"""Set-up files for OpenSim, and its inverse kinematics where it is installed."""

import importlib.util
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import fail, succeed
from helpers.opensim import write_model
from helpers.striders import strider

from apf.body.kinematics import posed_joints
from apf.formats.angles import opensim_coordinates
from apf.formats.opensim.model import read_model
from apf.formats.opensim.setup import marker_places, scale_factors
from apf.formats.trc import read_trc
from apf.tracking.smoothing import smooth_track
from cl import InputError


def test_the_scaled_model_has_the_lengths_of_the_body(tmp_path: Path) -> None:
    """Thigh, forearm and the width of the hips; a marker that is fixed to the chest is where it is
    in the body while both stand upright."""
    model, body = read_model(write_model(tmp_path / "model.osim")), strider(4).its_body
    scales = scale_factors(body, model)
    upright = posed_joints(body, np.zeros((1, body.n_dof)))[0]
    at = dict(zip(body.joint_names, upright, strict=True))
    thigh = np.linalg.norm(model.near["tibia_r"] * scales["femur_r"])
    assert thigh == pytest.approx(np.linalg.norm(at["r_knee"] - at["r_hip"]), rel=1e-6)
    hips = np.abs((model.near["femur_l"] - model.near["femur_r"]) * scales["pelvis"])[2]
    assert hips == pytest.approx(np.linalg.norm(at["l_hip"] - at["r_hip"]), rel=1e-6)
    carrier, inside, _ = marker_places(body, model, scales)["neck"]
    place = model.origin(carrier, scales) + inside * scales[carrier]
    middle = (model.near["femur_l"] + model.near["femur_r"]) / 2 * scales["pelvis"]
    expected = (at["neck"] - (at["l_hip"] + at["r_hip"]) / 2)[[0, 2]]  # forward, up
    np.testing.assert_allclose((place - middle)[:2], expected, atol=1e-6)


def test_export_writes_the_setup(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without OpenSim: a TRC with every marker of marker set and tasks; the model starts in the
    first pose, within its limits. A second export replaces the files."""
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    track = strider(20)
    track.save(tmp_path / "track.npz")
    wanted = ["--to", "osim", "--osim-model", str(write_model(tmp_path / "model.osim"))]
    for _ in range(2):
        said = succeed("apf", "export", tmp_path, *wanted).out
    assert "not installed" in " ".join(said.split())
    folder = tmp_path / "opensim"
    made = {path.name for path in folder.iterdir()}
    assert made == {"generic.osim", "markers.trc", "markers.xml", "scaling.xml", "ik.xml"}
    markers = read_trc(folder / "markers.trc")
    for name, tag in (("ik", "IKMarkerTask"), ("markers", "Marker")):
        entries = ElementTree.parse(folder / f"{name}.xml").iter(tag)
        assert {entry.get("name") for entry in entries} == set(markers.joint_names)
    smooth = smooth_track(track)
    wrist, front = (markers.joint_names.index(name) for name in ("l_wrist", "head_front"))
    wrist_joint, top = (smooth.joint_names.index(name) for name in ("l_wrist", "head_top"))
    at = markers.joints
    np.testing.assert_allclose(at[:, wrist], smooth.joints[:, wrist_joint], atol=1e-4)
    away = np.linalg.norm(at[:, front] - smooth.joints[:, top], axis=-1)
    np.testing.assert_allclose(away, 0.1, atol=1e-4)
    knee = opensim_coordinates(smooth.its_body, smooth.poses[:1])["knee_angle_r"][0]
    model = ElementTree.parse(folder / "generic.osim")
    started = model.findtext(".//Coordinate[@name='knee_angle_r']/default_value", "")
    assert float(started) == pytest.approx(min(max(np.radians(knee), 0), 0.01), abs=1e-5)


def test_no_model_for_opensim(tmp_path: Path) -> None:
    strider(4).save(tmp_path / "track.npz")
    lacking = write_model(tmp_path / "lacking.osim", left_out="hand_l")
    said = fail("apf", "export", tmp_path, "--to", "osim", "--osim-model", lacking)
    assert "lacking.osim: no joint that carries hand_l" in " ".join(said.split())
    assert not (tmp_path / "opensim").exists()
    said = fail("apf", "export", tmp_path, "--to", "trc", "--osim-model", lacking)
    assert "expected --to osim" in " ".join(said.split())
    (tmp_path / "text.osim").write_text("no model")
    with pytest.raises(InputError, match=r"text\.osim: .*expected an OpenSim model"):
        read_model(tmp_path / "text.osim")


def test_inverse_kinematics_by_opensim(tmp_path: Path) -> None:
    """OpenSim's knee angles are those of the poses within 4 degrees."""
    for package in ("opensim", "Pose2Sim"):  # the tools, and the model
        if importlib.util.find_spec(package) is None:
            pytest.skip(f"without {package}")
    track = strider(20)
    track.save(tmp_path / "track.npz")
    succeed("apf", "export", tmp_path, "--to", "osim")
    lines = (tmp_path / "opensim" / "ik.mot").read_text().splitlines()
    head = lines.index("endheader") + 1
    table = np.array([line.split() for line in lines[head + 1 :]], float)
    smooth = smooth_track(track)
    ours = opensim_coordinates(smooth.its_body, smooth.poses)["knee_angle_r"]
    found = table[:, lines[head].split().index("knee_angle_r")]
    assert np.abs(found - ours).max() < 4
