"""One rig written in every format is read as the same cameras."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import footage
from helpers.camera_programs import PROGRAMS
from helpers.camera_texts import FORMATS, Files, assert_same, colmap, matlab_cells, write_files
from helpers.commands import succeed
from helpers.footage import words

from cl import InputError
from psfs.cameras.calibration import find_calibration, read_calibration
from psfs.cameras.calibration.writers import WRITERS, write_calibration
from psfs.cameras.camera import Camera, CameraRig
from psfs.diagnostics.sequence_info import SequenceInfo
from psfs.request import FORMATS as FORMATS_OF_CONVERT
from psfs.sequence import Sequence

MIRROR = np.diag([-1.0, 1, 1])


def plain_rig() -> CameraRig:
    """Return pinhole cameras with square pixels and centred principal points, which every format
    can express."""
    width, height = footage.SIZE
    K = np.array([[60.0, 0, (width - 1) / 2], [0, 60.0, (height - 1) / 2], [0, 0, 1]])
    cameras = (replace(camera, K=K, distortion=np.zeros(5)) for camera in footage.rig(4))
    return CameraRig(tuple(cameras))


def bent_rig() -> CameraRig:
    """Return the same cameras with lenses that bend."""
    bend = np.array([0.1, -0.02, 1e-3, 2e-3, 3e-3])
    return CameraRig(tuple(replace(camera, distortion=bend) for camera in plain_rig()))


#: What other names programs give to the first camera, and what they say of its lens.
NAMES = {
    "mccalib": "camera_0",
    "skeletool": "camera_0",
    "numbered": "camera_0",
    "caliscope": "cam_1",
}
LENSES = {"skeletool": 0, "numbered": 2}


@pytest.mark.parametrize("program", PROGRAMS)
def test_layouts_of_other_programs(tmp_path: Path, program: str) -> None:
    files = write_files(tmp_path / "a", PROGRAMS[program](bent_rig()))
    path = files[0] if len(files) == 1 else tmp_path / "a"
    found = read_calibration(path, sizes=lambda names: [footage.SIZE] * len(names))
    assert found.names[0] == NAMES.get(program, "cam01")
    assert_same(found, bent_rig(), LENSES.get(program, 5))
    if program == "numbered":
        assert find_calibration(tmp_path / "a") == path


@pytest.mark.parametrize("program", ["toml", "nerf", "colmap", "kalibr"])
def test_fisheye_lenses_are_read(tmp_path: Path, program: str) -> None:
    """All say the same lens of OpenCV's."""
    bend, K = [-0.02, 0.01, -5e-3, 1e-3], plain_rig()[0].K
    frame = {"file_path": "a", "transform_matrix": np.diag([1.0, -1, -1, 1]).tolist()}
    lens = {"fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2] + 0.5, "cy": K[1, 2] + 0.5}
    stated = {"camera_model": "OPENCV_FISHEYE", "w": footage.SIZE[0], "h": footage.SIZE[1]}
    bends = dict(zip(("k1", "k2", "k3", "k4"), bend, strict=True))
    whole = K[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    texts = {
        "toml": f"[a]\nsize = {list(footage.SIZE)}\nmatrix = {K.tolist()}\nfisheye = true\n"
        f"distortions = {bend}\nrotation = [0, 0, 0]\ntranslation = [0, 0, 0]\n",
        "nerf": json.dumps({**stated, **lens, **bends, "frames": [frame]}),
        "colmap": f"1 OPENCV_FISHEYE {words(np.array(footage.SIZE)).replace('.0', '')} "
        f"{words(np.array([*lens.values(), *bend]))}",
        "kalibr": f"a:\n  camera_model: pinhole\n  distortion_model: equidistant\n"
        f"  distortion_coeffs: {bend}\n  intrinsics: {whole}\n  resolution: {list(footage.SIZE)}\n",
    }
    names = {"toml": "c.toml", "nerf": "transforms.json", "colmap": "cameras.txt"}
    path = tmp_path / names.get(program, "camchain.yaml")
    path.write_text(texts[program])
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.png\n\n")
    (camera,) = read_calibration(path)
    assert camera.fisheye and camera.size == footage.SIZE
    points = np.array([[1.5, 0.5, 1.0], [-0.4, 1.0, 2.0]])
    expected = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), K, np.array(bend)
    )[0][:, 0]
    np.testing.assert_allclose(camera.project(points)[0], expected, atol=1e-9)
    if program == "toml":
        path.write_text(texts["toml"].replace("[-0.02,", "[0.3, -0.02,"))
        with pytest.raises(InputError, match="5 distortion coefficients; expected at most 4"):
            read_calibration(path)


def sequence_in(folder: Path, files: Files, rig: CameraRig) -> Path:
    for camera in rig:
        footage.write_image(folder / "images" / camera.name / "0000.png", 90)
    write_files(folder, files)
    return folder


def native(folder: Path, rig: CameraRig) -> Path:
    footage.write_toml(folder / "calibration.toml", footage.tables(rig))
    return sequence_in(folder, {}, rig)


@pytest.mark.parametrize("kind", FORMATS)
def test_formats_are_found_in_a_folder(tmp_path: Path, kind: str) -> None:
    sequence = Sequence.open(sequence_in(tmp_path, FORMATS[kind](plain_rig()), plain_rig()))
    assert sequence.rig.names == plain_rig().names
    assert_same(sequence.rig, plain_rig())
    assert SequenceInfo(sequence).warnings == []


@pytest.mark.parametrize("kind", sorted(FORMATS.keys() - {"colmap", "colmap_binary", "vicon"}))
def test_left_handed_worlds_are_mended(tmp_path: Path, kind: str) -> None:
    """The file's world is mirrored, as programs with other axes write it; the pictures are the
    same."""
    rig, mirrored = plain_rig(), []
    for camera in rig:
        fake = object.__new__(Camera)  # which would refuse such a rotation
        fake.__dict__.update({**vars(camera), "R": camera.R @ MIRROR})
        mirrored.append(fake)
    wrong = CameraRig(tuple(mirrored))
    sequence = Sequence.open(sequence_in(tmp_path / "a", FORMATS[kind](wrong), wrong))
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 3))
    for found, camera in zip(sequence.rig, rig, strict=True):
        np.testing.assert_allclose(found.project(points)[0], camera.project(points)[0], atol=1e-5)
    assert "left-handed" in " ".join(sequence.notes)


def test_worlds_of_both_hands_are_refused(tmp_path: Path) -> None:
    lines = [
        f"{c.name} {words(c.K)} {words(c.R @ (MIRROR if k else np.eye(3)))} {words(c.t)}"
        for k, c in enumerate(plain_rig())
    ]
    (tmp_path / "x_par.txt").write_text("\n".join(["4", *lines]))
    with pytest.raises(InputError, match=r"x_par\.txt: 3 of 4 rotations have determinant -1"):
        read_calibration(tmp_path / "x_par.txt", sizes=footage.SIZE)


def test_picture_sizes_of_a_flat_folder_by_order(tmp_path: Path) -> None:
    """The pictures' names are not the cameras': they are assigned in order, with a note."""
    (tmp_path / "dino_Ps.mat").write_bytes(matlab_cells(plain_rig())["dino_Ps.mat"])
    for number in range(4):
        footage.write_image(tmp_path / f"viff.{number:03d}.png", 40 * number)
    sequence = Sequence.open(tmp_path)
    assert any("viff.002" in note and "order" in note for note in sequence.notes)
    images = sequence.read(0).images
    assert images is not None and [int(image.mean()) for image in images] == [0, 40, 80, 120]


def test_convert_writes_a_native_folder(tmp_path: Path) -> None:
    rig, out = plain_rig(), tmp_path / "native"
    folder = sequence_in(tmp_path / "a", colmap(rig), rig)
    flags = ["--unit", "cm", "--up", "y", "--cameras", "cam01,cam03", "--subject", "object"]
    box = ["--volume", "own:-1,1,-2,2,-3,3"]
    assert "2 cameras, 1 frames" in succeed("psfs", "convert", folder, "-o", out, *flags, *box).out
    given = {"unit": "cm", "up": "y", "cameras": ["cam01", "cam03"]}
    before, after = Sequence.open(folder, **given), Sequence.open(out)
    for a, b in zip(after.rig, before.rig, strict=True):
        assert a.name == b.name
        np.testing.assert_allclose(a.centre, b.centre, atol=1e-9)
        np.testing.assert_allclose(a.R, b.R, atol=1e-9)
    assert after.subject == "object" and after.unit == "m" and after.volume is not None
    np.testing.assert_allclose(after.volume, [[-0.03, -0.01, -0.02], [0.03, 0.01, 0.02]])
    np.testing.assert_array_equal(after.read(0).images, before.read(0).images)


@pytest.mark.parametrize("kind", FORMATS_OF_CONVERT)
def test_convert_writes_the_calibration_of_other_programs(tmp_path: Path, kind: str) -> None:
    assert tuple(WRITERS) == FORMATS_OF_CONVERT
    rig = CameraRig(
        tuple(replace(c, distortion=np.array([-0.1, 0.02, 0.001, -0.002, 0])) for c in plain_rig())
    )
    folder = native(tmp_path / "a", rig)
    succeed("psfs", "convert", str(folder), "-o", str(tmp_path / "b"), "--to", kind)
    path = find_calibration(tmp_path / "b") or tmp_path / "b" / "Calib.qca.txt"
    found = read_calibration(path)
    assert found.names == rig.names or kind == "caliscope"
    assert_same(found, rig)
    bent = CameraRig(tuple(replace(c, distortion=np.array([0, 0, 0, 0, 0.1])) for c in rig))
    if kind == "qualisys":
        with pytest.raises(InputError, match="cam01 has k3"):
            write_calibration(tmp_path, bent, kind)
    else:
        write_calibration(tmp_path / "c", bent, kind)
    with pytest.raises(InputError, match="Tsai"):
        tsai = replace(rig[0], distortion=np.zeros(5), kappa=0.1)
        write_calibration(tmp_path, CameraRig((tsai,)), kind)
