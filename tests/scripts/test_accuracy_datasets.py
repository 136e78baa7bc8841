"""Readers of BioCV, TotalCapture and Human3.6M, on small files made in their layouts."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from accuracy.datasets import _UPRIGHT, _make_human36m_cameras, prepare_dataset
from accuracy.suite import suite_folders, true_stature
from helpers.striders import strider

from apf.evaluation.truth import load_truth
from apf.formats.c3d import write_c3d
from apf.formats.trc import JointSeries
from cl import InputError
from psfs.cameras.calibration import read_calibration

_LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
#: World to camera: 3 m away, x to the right, looking along the world's y.
_R, _T = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.array([0.1, 1.0, 3.0])
_K, _SIZE = np.array([[900.0, 0, 320], [0, 910, 240], [0, 0, 1]]), (640, 480)


def _limbs() -> tuple[list[str], np.ndarray]:
    """Return names and joints (F, 12, 3) m of somebody who walks, Z up."""
    track = strider(4)
    names = [f"{side}_{joint}" for side in "lr" for joint in _LIMBS]
    return names, track.joints[:, [track.joint_names.index(name) for name in names]]


def _project(points: np.ndarray) -> np.ndarray:
    seen = points @ _R.T + _T
    return (seen[..., :2] / seen[..., 2:]) * _K[[0, 1], [0, 1]] + _K[:2, 2]


def _biocv(folder: Path) -> tuple[list[str], np.ndarray]:
    names, joints = _limbs()
    trial = folder / "P03" / "P03_WALK_01"
    trial.mkdir(parents=True)
    moved = np.eye(4)
    moved[:3, :3], moved[:3, 3] = _R, 1000 * _T
    for number in range(2):
        (trial / f"{number:02d}.mp4").write_bytes(b"film")
        rows = [str(_SIZE[0]), str(_SIZE[1])]
        rows += [" ".join(map(str, row)) for row in _K]
        rows += ["", *(" ".join(map(str, row)) for row in moved), "", "-.1 .02 0 0 0"]
        (folder / "P03" / f"{number:02d}.mp4.calib").write_text("\n".join(rows) + "\n")
    sides = {"l": "LEFT", "r": "RIGHT"}
    theirs = [f"{sides[name[0]]}_{name[2:].upper()}".replace("SHOULDER", "SHO") for name in names]
    series = JointSeries((*theirs, "C7"), np.concatenate([joints, joints[:, :1]], 1), 200.0,
                         np.arange(4))  # fmt: skip
    write_c3d(trial / "markers.c3d", series)
    return names, joints


def _totalcapture(folder: Path) -> tuple[list[str], np.ndarray]:
    names, joints = _limbs()
    numbers = [0, _SIZE[1] - 1, 0, _SIZE[0] - 1, _K[0, 0], _K[1, 1], _K[0, 2], _K[1, 2], 0.0]
    camera = " ".join(map(str, [*numbers, *(_R @ _UPRIGHT).ravel(), *_T]))
    (folder / "calibration.cal").write_text(f"2 1\n{camera}\n{camera}\n")
    for number in (1, 2):
        video = folder / "S1" / "video" / "walking1" / f"TC_S1_walking1_cam{number}.mp4"
        video.parent.mkdir(parents=True, exist_ok=True)
        video.write_bytes(b"film")
    words = {"shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand", "hip": "UpLeg",
             "knee": "Leg", "ankle": "Foot"}  # fmt: skip
    sides = {"l": "Left", "r": "Right"}
    lines = ["\t".join(["Hips", *(sides[name[0]] + words[name[2:]] for name in names)]) + "\t"]
    for row in np.concatenate([joints[:, :1], joints], 1) @ _UPRIGHT / 0.0254:
        lines.append("\t".join(" ".join(f"{v:.6f}" for v in point) for point in row) + "\t")
    path = folder / "S1" / "vicon" / "walking1" / "gt_skel_gbl_pos.txt"
    path.parent.mkdir(parents=True)
    path.write_text("\n".join(lines) + "\n")
    return names, joints


def _human36m(folder: Path) -> tuple[list[str], np.ndarray]:
    cdfwrite = pytest.importorskip("cdflib.cdfwrite", reason="the extra dev is not installed")
    names, joints = _limbs()
    numbers = np.random.default_rng(0).normal(size=(4, 11, 6))  # of other subjects
    # Rx(a) Ry(b) Rz(c) with a = 90 degrees is _R turned by c.
    numbers[:, 8] = [np.pi / 2, 0, 0, *(1000 * -_R.T @ _T)]
    inner = [_K[0, 0], _K[1, 1], _K[0, 2], _K[1, 2], 0, 0, 0, 0, 0]
    words = " ".join(f"{v:.9f}" for v in [*numbers.ravel(), *np.tile(inner, 4)])
    (folder / "metadata.xml").write_text(f"<metadata><w0>[{words}]</w0></metadata>")
    poses = folder / "S9" / "MyPoseFeatures" / "D3_Positions"
    poses.mkdir(parents=True)
    rows = [6, 7, 8, 17, 18, 19], [1, 2, 3, 25, 26, 27]  # hip, knee, ankle, shoulder, elbow, wrist
    order = [_LIMBS.index(n) for n in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")]
    pose = np.full((1, len(joints), 32, 3), 1e6)
    for side, of in enumerate(rows):
        pose[0, :, of] = 1000 * np.swapaxes(joints[:, [6 * side + k for k in order]], 0, 1)
    path = poses / "Walking 1.cdf"
    with cdfwrite.CDF(path, cdf_spec={"Compressed": 6}) as file:
        spec = {"Variable": "Pose", "Data_Type": 45, "Num_Elements": 1, "Rec_Vary": True,
                "Dim_Sizes": [len(joints), 96]}  # fmt: skip
        file.write_var(spec, var_data=pose.reshape(1, len(joints), 96))
    (folder / "S9" / "Videos").mkdir()
    for camera in ("54138969", "55011271", "58860488", "60457274"):
        (folder / "S9" / "Videos" / f"Walking 1.{camera}.mp4").write_bytes(b"film")
    return names, joints


@pytest.mark.parametrize(
    ("kind", "write", "name", "fps"),
    [
        ("biocv", _biocv, "P03_P03_WALK_01", 200.0),
        ("totalcapture", _totalcapture, "S1_walking1", 60),
        ("human36m", _human36m, "S9_Walking_1", 50),
    ],
)
def test_a_trial_becomes_a_sequence_with_truth(
    tmp_path: Path,
    kind: str,
    write: Callable[[Path], tuple[list[str], np.ndarray]],
    name: str,
    fps: float,
) -> None:
    """Cameras and joints in metres, Z up, by our names; each video under its camera's name."""
    names, joints = write(tmp_path)
    for _ in range(2):  # a second time replaces the first
        (folder,) = suite_folders(prepare_dataset(kind, tmp_path, tmp_path / "suite"))
    assert folder.name == name
    truth = load_truth(folder / "truth.npz")
    assert list(truth.joint_names) == names and truth.fps == pytest.approx(fps)
    np.testing.assert_allclose(truth.joints, joints, atol=1e-5)
    rig = read_calibration(folder / "calibration.toml")
    videos = sorted(path.stem for path in (folder / "videos").iterdir())
    assert [camera.name for camera in rig] == videos and len(videos) == (
        4 if kind == "human36m" else 2
    )
    if kind != "biocv":  # without distortion here
        np.testing.assert_allclose(rig[0].project(truth.joints)[0], _project(joints), atol=0.01)
    assert rig[1].size == ((1000, 1000) if kind == "human36m" else _SIZE)
    np.testing.assert_allclose(rig.centres, np.tile(-_R.T @ _T, (len(rig), 1)), atol=1e-6)
    assert 1.5 < true_stature(folder, truth) < 2.0


def test_human36ms_cameras_turn_about_x_then_y_then_z() -> None:
    numbers = np.random.default_rng(1).uniform(0.2, 1, 300)
    place = 3 * 11 * 6 + 6 * 2  # the fourth camera, subject 3
    turns = [
        cv2.Rodrigues(angle * axis)[0]
        for angle, axis in zip(numbers[place : place + 3], np.eye(3), strict=True)
    ]
    camera = _make_human36m_cameras(numbers, 3)[3]
    np.testing.assert_allclose(camera.R, turns[0] @ turns[1] @ turns[2], atol=1e-12)
    np.testing.assert_allclose(-camera.R.T @ camera.t, numbers[place + 3 : place + 6] / 1000)
    k1, k2, k3, p1, p2 = numbers[-5:]
    assert camera.distortion.tolist() == [k1, k2, p1, p2, k3] and camera.K[0, 2] == numbers[-7]


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    def refused(kind: str, said: str) -> None:
        with pytest.raises(InputError, match=said):
            prepare_dataset(kind, tmp_path, tmp_path / "suite")

    refused("biocv", "no trial with videos and joints; expected biocv")
    refused("totalcapture", r"0 files calibration\.cal; expected one")
    refused("human36m", r"0 files metadata\.xml; expected one")
    (tmp_path / "metadata.xml").write_text("<metadata><w0>[1 2]</w0></metadata>")
    refused("human36m", "w0 has 2 numbers; expected 300")
    _biocv(tmp_path)
    calibration = tmp_path / "P03" / "01.mp4.calib"
    calibration.write_text("640 480 1")
    refused("biocv", r"01\.mp4\.calib: 3 numbers; expected 32")
    calibration.unlink()
    refused("biocv", r"no 01\.mp4\.calib beside it")
