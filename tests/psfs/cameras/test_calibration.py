"""Calibration readers read back a rig in each format; invalid ones are named in one line."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers import footage
from helpers.camera_texts import assert_same, humaneva, write_files

from cl import InputError
from psfs.cameras.calibration import read_calibration
from psfs.cameras.calibration.number_lists import read_humaneva
from psfs.cameras.names import contains_name, match_files_to_cameras, natural_key
from psfs.cameras.units import metres_per_unit, rotate_rig, rotation_to_z_up, scale_rig

SIZE = footage.SIZE


@pytest.mark.parametrize("views", [1, 11])
def test_toml(tmp_path: Path, views: int) -> None:
    rig = footage.rig(views)
    tables = {"metadata": {"error": 0.1}, "charuco": {"a": 1}, **footage.tables(rig)}
    footage.write_toml(tmp_path / "c.toml", dict(reversed(tables.items())))
    read = read_calibration(tmp_path / "c.toml")
    assert read.names == rig.names
    assert_same(read, rig)


def test_toml_natural_order_unit_and_freemocap(tmp_path: Path) -> None:
    rig = footage.rig(3)
    tables = footage.tables(rig)
    renamed = dict(zip(["cam_10", "cam_2", "cam_1"], tables.values(), strict=True))
    for table in renamed.values():
        del table["name"]
        table["distortions"] = table["distortions"][:4]
    footage.write_toml(tmp_path / "c.toml", renamed)
    read = read_calibration(tmp_path / "c.toml", unit="mm")
    assert read.names == ["cam_1", "cam_2", "cam_10"]
    np.testing.assert_allclose(read[2].t, rig[0].t / 1000)
    for table in renamed.values():
        table["world_position"] = [0.0, 0.0, 0.0]
    footage.write_toml(tmp_path / "c.toml", renamed)
    with pytest.raises(InputError, match=r"c\.toml.*FreeMoCap.*unit"):
        read_calibration(tmp_path / "c.toml")
    assert len(read_calibration(tmp_path / "c.toml", unit="mm")) == 3


def test_humaneva(tmp_path: Path) -> None:
    rig = footage.rig(3)
    for camera in rig:
        (tmp_path / f"{camera.name}.cal").write_text(humaneva(camera))
    assert_same(read_humaneva([tmp_path / "cam02.cal"], None, SIZE), rig.subset(["cam02"]))
    with pytest.raises(InputError, match="no picture sizes"):
        read_calibration(tmp_path)


def test_projection_matrices_of_three_rows_and_any_scale(tmp_path: Path) -> None:
    rig = footage.rig(3)
    text = ""
    for camera in rig:
        P = -2.5 * camera.K @ np.column_stack([camera.R, camera.t])
        text += "\n".join(" ".join(map(repr, row)) for row in P.tolist()) + "\n\n"
    (tmp_path / "projections.txt").write_text(text)
    read = read_calibration(tmp_path / "projections.txt", sizes=SIZE)
    assert_same(read, rig, 0)
    assert all(np.linalg.det(camera.R) > 0 for camera in read)


def test_rounded_rotations_are_mended(tmp_path: Path) -> None:
    camera = footage.rig(1)[0]
    noisy = camera.R + np.random.default_rng(0).uniform(-2e-4, 2e-4, (3, 3))
    text = " ".join(map(str, ["a.png", *camera.K.ravel(), *noisy.ravel(), *camera.t]))
    (tmp_path / "x_par.txt").write_text("1\n" + text)
    R = read_calibration(tmp_path / "x_par.txt", sizes=SIZE)[0].R
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R, camera.R, atol=5e-4)


@pytest.mark.parametrize(
    ("unit", "metres"),
    [("m", 1), ("cm", 0.01), ("mm", 0.001), ("0.76mm", 0.00076), ("0.76 mm", 0.00076), (2.5, 2.5)],
)
def test_units(unit, metres: float) -> None:
    assert metres_per_unit(unit) == pytest.approx(metres)


@pytest.mark.parametrize("up", ["x", "-x", "y", "-y", "z", "-z"])
def test_the_up_axis_becomes_z_and_the_pictures_stay(up: str) -> None:
    A = rotation_to_z_up(up)
    axis = (-1 if up[0] == "-" else 1) * np.eye(3)["xyz".index(up[-1])]
    np.testing.assert_array_equal(A @ axis, [0, 0, 1])
    assert np.linalg.det(A) == pytest.approx(1)
    rig = footage.rig(3)
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (20, 3))
    moved = scale_rig(rotate_rig(rig, A), 0.01)
    for before, after in zip(rig, moved, strict=True):
        np.testing.assert_allclose(
            after.project(0.01 * points @ A.T)[0], before.project(points)[0], atol=1e-8
        )


def test_names() -> None:
    names = ["cam_10", "cam_2", "Cam1"]
    assert sorted(names, key=natural_key) == ["Cam1", "cam_2", "cam_10"]
    assert contains_name("silh_cam01_0002", "cam_1")
    assert not contains_name("silh_cam10_0001", "cam1")
    pairs, note = match_files_to_cameras(["cam_01", "cam_02"], ["cam2", "CAM1"], "videos")
    assert pairs == {"cam_01": "CAM1", "cam_02": "cam2"} and note is None
    pairs, note = match_files_to_cameras(["left", "right"], ["b10", "b9"], "videos")
    assert pairs == {"left": "b9", "right": "b10"} and note and "b9 for left" in note
    with pytest.raises(InputError, match=r"4 of them \(a, b, c, d\) for 3 cameras \(a, b, c\)"):
        match_files_to_cameras(["a", "b", "c"], ["a", "b", "c", "d"], "videos")
    assert match_files_to_cameras(["a", "b"], ["b", "c", "d"], "videos", ["b"]) == (
        {"b": "b"},
        None,
    )


@pytest.mark.parametrize(
    ("cameras", "found", "expected"),
    [
        ("cam01 cam02 cam03", "GoPro9_cam03 iPhone13_cam02 Pixel7_cam01", (2, 1, 0)),
        ("1 2", "cam1_take2 cam2_take2", (0, 1)),  # what all share tells nothing
        ("left back_left", "x_back_left y_left", (1, 0)),  # the longer of nested names
        ("A1 B2", "session_b2_4711.trim session_a1_4712.trim", (1, 0)),
        (
            "cam1 cam2 cam3",
            "cam1_cam2_a cam3_b cam3",
            "cam1_cam2_a fits several cameras: cam1, cam2",
        ),
        ("cam1 cam2 cam3", "cam1_a cam1_b cam2", "cam1_a, cam1_b all fit camera cam1"),
    ],
)
def test_files_are_named_after_cameras(
    cameras: str, found: str, expected: tuple[int, ...] | str
) -> None:
    names, files = cameras.split(), found.split()
    if isinstance(expected, str):
        with pytest.raises(InputError, match=expected):
            match_files_to_cameras(names, files, "videos")
    else:
        right = {name: files[row] for name, row in zip(names, expected, strict=True)}
        assert match_files_to_cameras(names, files, "videos") == (right, None)


def nerf(**said: object) -> str:
    frame = {"file_path": "a", "transform_matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]}
    return json.dumps({**said, "frames": [frame]})


OMNI = """cam0:
  camera_model: omni
  distortion_model: radtan
  intrinsics: [9, 9, 1, 1]
  distortion_coeffs: [0, 0, 0, 0]
  resolution: [64, 48]
"""
THEIA = "<calibration><cameras><camera><intrinsic/></camera></cameras></calibration>"
VICON = "<Cameras><Camera><KeyFrames><KeyFrame/></KeyFrames></Camera></Cameras>"
BROKEN: list[tuple[str, str | bytes, str]] = [
    ("c.toml", "title = 'nothing'", "no camera tables"),
    ("d.toml", "[cam01", "malformed TOML"),
    ("c.cal", "1 2 3", "3 numbers; expected at least 22"),
    ("c.cal", "1 2 x", "found 'x'"),
    ("c.cal", "500 500 32 24 0 0 0 0 0 0 1 0 0 0 1 0 0 0 -2 0 0 0", "R is not a rotation"),
    ("c.cal", "500 500 32 24 0 0 0 0 0 0 1 0 0 0 nan 0 0 0 1 0 0 0", "not finite"),
    ("c.xml", "<?xml version='1.0'?><opencv_storage><a></opencv_storage>", "malformed"),
    ("c.yml", "%YAML:1.0\n---\nsomething: 3\n", "no CameraMatrix"),
    ("c.json", "", "c.json"),
    ("c.json", '{"cameras": [{"name": "a", "distCoef": []}]}', "cameras a with distCoef, name"),
    ("x_par.txt", "1\na.png 1 2 3", "view a: 3 numbers; expected 21"),
    ("x_par.txt", "4\na.png " + "1 " * 21, "1 views; the first line promises 4"),
    ("p.txt", "cam 1 2 3", "expected 12"),
    ("p.txt", "cam " + "1 " * 12, "singular"),
    ("p.txt", "cam nan " + "1 " * 11, "not finite"),
    ("p.txt", "", "no projection matrix"),
    ("cam1.cpar", "1 2 3", "3 words; expected Tsai's 17 numbers"),
    ("cam1.cpar", "kappa1 = 0\nf = 5\nTz = 3\nRz = 0\n", "lacks dpx, cx, cy, sx, tx, ty, rx, ry"),
    ("a.mat", "nothing", "expected a MATLAB"),
    ("camchain.yaml", OMNI, "camera cam0: lens is 'omni-radtan'; expected pinhole-radtan"),
    ("transforms.json", '{"frames": []}', "frames"),
    ("transforms.json", '{"frames": [{"file_path": "a"}]}', "transform_matrix"),
    ("transforms.json", nerf(fl_x=9, camera_model="FISHEYE624"), "a: camera_model FISHEYE624; exp"),
    ("transforms.json", nerf(fl_x=9, k4=0.1), "a: k4; expected a pinhole or fisheye camera"),
    ("transforms.json", nerf(fl_x=9, latlong=True), "camera a: latlong; expected"),
    ("cameras.txt", "1 FISHEYE 10 10 1 2 3", "camera model FISHEYE"),
    ("a.qca.txt", "<calibration><cameras/></calibration>", "no elements cameras"),
    ("b.qca.txt", "<calibration><cameras><camera></cameras>", "expected XML with"),
    ("c.qca.txt", '<!DOCTYPE a [<!ENTITY b "c">]><calibration/>', "document type"),
    ("cameras.bin", b"\1\0\0\0\0\0\0\0\1\0", "ends in the middle"),
    ("cameras.bin", b"\xff" * 8, "expected at most 1000"),
    ("theia.txt", THEIA, "Theia3D is not read"),
    ("a.mcal", "<a/>", "no elements "),
    ("b.mcal", "<a><Camera Serial='M1'/></a>", "Motive 3.2"),
    ("a.xcp", "<Cameras><Camera/></Cameras>", "no elements Camera/KeyFrames"),
    ("b.xcp", VICON, "lacks FOCAL_LENGTH"),
    ("calib.txt", "1 0\n0 9 0 9 1 2 3 4 5 6 7 8 9 0 1 2 3 4 5", "expected 22 of Surrey"),
]


@pytest.mark.parametrize(("name", "content", "expected"), BROKEN)
def test_broken(tmp_path: Path, name: str, content: str | bytes, expected: str) -> None:
    write_files(tmp_path, {name: content})
    if name == "cameras.txt":
        (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.png\n\n")
    with pytest.raises(InputError) as caught:
        read_calibration(tmp_path / name, sizes=(64, 48))
    message = str(caught.value)
    assert expected in message and name in message and "\n" not in message


@pytest.mark.parametrize(
    ("ending", "lens"), [("cal", "500 500 32 24 0 0 0 0 0 0"), ("txt", "500 0 32 0 500 24 0 0 1")]
)
def test_two_files_of_one_camera(tmp_path: Path, ending: str, lens: str) -> None:
    for name in (f"c1.{ending}", f"c1.{ending.upper()}"):
        (tmp_path / name).write_text(f"{lens} 1 0 0 0 1 0 0 0 1 0 0 2")
    with pytest.raises(InputError, match=f"{tmp_path.name}: camera names must differ"):
        read_calibration(tmp_path, sizes=(64, 48))


def test_missing_binary_and_mixed(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such calibration"):
        read_calibration(tmp_path / "none.toml")
    for name in ("a.toml", "a.cal", "a.xml", "a.txt"):
        (tmp_path / name).write_bytes(b"\xff\xfe\x00\x01\x80")
        with pytest.raises(InputError, match=name):
            read_calibration(tmp_path / name, sizes=(64, 48))
    with pytest.raises(InputError, match="all of one kind"):
        read_calibration(tmp_path, sizes=(64, 48))
