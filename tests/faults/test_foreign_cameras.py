"""Calibrations of other programs, damaged: one line that names the file, or the same cameras."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import faults, footage
from helpers.fuzz import CHANGE, FUZZING, MEMORY, changed
from helpers.memory import limited_memory
from hypothesis import given
from hypothesis import strategies as st

from cl import InputError
from psfs.cameras.calibration import read_calibration
from psfs.cameras.camera import CameraRig


def words(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values).ravel())


def middlebury(rig: CameraRig) -> dict[str, str]:
    lines = [f"{c.name}.png {words(c.K)} {words(c.R)} {words(c.t)}" for c in rig]
    return {"x_par.txt": "\n".join([str(len(rig)), *lines])}


def surrey(rig: CameraRig) -> dict[str, str]:
    text = f"{len(rig)} 1\n"
    for c in rig:
        lens = words(np.array([c.K[0, 0], c.K[1, 1], c.K[0, 2], c.K[1, 2], c.distortion[0]]))
        text += f"0 {c.size[1] - 1} 0 {c.size[0] - 1}\n{lens}\n{words(c.R)}\n{words(c.t)}\n"
    return {"calibration.txt": text}


def colmap(rig: CameraRig) -> dict[str, str]:
    cameras, images = "", ""
    for number, c in enumerate(rig, 1):
        lens = [c.K[0, 0], c.K[1, 1], c.K[0, 2] + 0.5, c.K[1, 2] + 0.5, *c.distortion[:4]]
        cameras += f"{number} OPENCV {c.size[0]} {c.size[1]} {words(np.array(lens))}\n"
        turn = cv2.Rodrigues(c.R)[0].ravel()
        angle = np.linalg.norm(turn)
        quaternion = [np.cos(angle / 2), *(np.sin(angle / 2) * turn / angle)]
        pose = words(np.array([*quaternion, *c.t]))
        images += f"{number} {pose} {number} {c.name}/0001.png\n\n"
    return {"images.txt": images, "cameras.txt": cameras}


def panoptic(rig: CameraRig) -> dict[str, str]:
    cameras = [
        {"name": c.name, "resolution": list(c.size), "K": c.K.tolist(), "R": c.R.tolist(),
         "distCoef": c.distortion.tolist(), "t": (100 * c.t[:, None]).tolist()}
        for c in rig
    ]  # fmt: skip
    return {"calibration_1.json": json.dumps({"cameras": cameras})}


def humaneva(rig: CameraRig) -> dict[str, str]:
    def text(c) -> str:
        lens = [c.K[0, 0], c.K[1, 1], c.K[0, 2], c.K[1, 2], 0.0, *c.distortion]
        return words(np.array([*lens, *c.R.ravel(), *(1000 * c.t), 0.1, 0.2, 0.3]))

    return {f"{c.name}.cal": text(c) for c in rig}


def easymocap(rig: CameraRig) -> dict[str, str]:
    def matrix(name: str, values: np.ndarray) -> str:
        rows, columns = values.shape
        data = ", ".join(repr(float(v)) for v in values.ravel())
        return (
            f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n"
            f"   data: [ {data} ]\n"
        )

    head = "%YAML:1.0\n---\nnames:\n" + "".join(f'   - "{c.name}"\n' for c in rig)
    inner = [
        (matrix(f"K_{c.name}", c.K), matrix(f"dist_{c.name}", c.distortion[None])) for c in rig
    ]
    outer = [
        (matrix(f"R_{c.name}", cv2.Rodrigues(c.R)[0]), matrix(f"T_{c.name}", c.t[:, None]))
        for c in rig
    ]
    return {
        "extri.yml": head + "".join(map("".join, outer)),
        "intri.yml": head + "".join(map("".join, inner)),
    }


FORMATS: dict[str, Callable[[CameraRig], dict[str, str]]] = {
    write.__name__: write for write in (middlebury, surrey, colmap, panoptic, humaneva, easymocap)
}


def written(folder: Path, name: str) -> Path:
    """Write a rig of three cameras; return the file, or the folder, to be read."""
    files = FORMATS[name](footage.rig(3))
    folder.mkdir()
    for file, text in files.items():
        (folder / file).write_text(text)
    return folder / next(iter(files)) if len(files) == 1 else folder


def read(path: Path) -> CameraRig:
    return read_calibration(path, sizes=lambda names: [footage.SIZE] * len(names))


@pytest.mark.parametrize("name", FORMATS)
def test_line_ends_of_windows(tmp_path: Path, name: str) -> None:
    path = written(tmp_path / "a", name)
    expected = read(path)
    for file in (tmp_path / "a").iterdir():
        file.write_bytes(file.read_bytes().replace(b"\n", b"\r\n"))
    found = read(path)
    assert found.names == expected.names
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a.K, b.K)
        np.testing.assert_array_equal(a.R, b.R)


@pytest.mark.parametrize("name", FORMATS)
@FUZZING
@given(changes=st.lists(CHANGE, min_size=1, max_size=3))
def test_damaged_cameras(tmp_path: Path, name: str, changes: list) -> None:
    shutil.rmtree(tmp_path / "a", ignore_errors=True)
    path = written(tmp_path / "a", name)
    file = next((tmp_path / "a").iterdir())
    data = file.read_bytes()
    for change in changes:
        data = changed(data, *change)
    file.write_bytes(data)
    with limited_memory(MEMORY):
        try:
            read(path)
        except InputError as error:
            text = str(error)
            assert str(tmp_path / "a") in text, text
            assert text.count(f"{file}: ") < 2, text


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("surrey", "3 1\n", "4 1\n", "expected 86 of Surrey's list of 4 cameras"),
        ("colmap", "1 0.", "1 2.", "a quaternion of length"),
        ("colmap", "cam02/", "cam01/", "camera names must differ; found cam01, cam01, cam03"),
        ("easymocap", "R_cam01: ", "R_cam09: ", "no Rot_cam01 among"),
    ],
)
def test_wrong_cameras(tmp_path: Path, name: str, old: str, new: str, said: str) -> None:
    path = written(tmp_path / "a", name)
    for file in (tmp_path / "a").iterdir():
        file.write_text(file.read_text().replace(old, new, 1))
    with pytest.raises(InputError) as error:
        read(path)
    assert said in str(error.value)


def test_rotation_vectors_of_many_turns(tmp_path: Path) -> None:
    path = written(tmp_path / "a", "easymocap")
    turned = footage.rig(3)
    far = 1e6 * cv2.Rodrigues(turned[0].R)[0].ravel()
    text = (path / "extri.yml").read_text()
    begin = text.index("data: [", text.index("R_cam01")) + len("data: [")
    end = text.index("]", begin)
    (path / "extri.yml").write_text(
        f"{text[:begin]} {', '.join(map(repr, far.tolist()))} {text[end:]}"
    )
    with pytest.raises(InputError, match=r"extri\.yml.*rad; expected up to"):
        read(path)


def test_times_in_microseconds(stock: Path) -> None:
    rows = [f"cam0{c},{k},{k * 33333}" for c in (1, 2, 3) for k in range(20)]
    file = stock / "walk/videos/timestamps.csv"
    file.write_text("\n".join(["cam_id,frame_index,frame_time", *rows]))
    faults.refused(
        ["psfs", "info", str(stock / "walk"), "--no-pictures"], stock, "expected times in s"
    )


def test_help_in_a_list_of_takes(stock: Path) -> None:
    (stock / "list.toml").write_text('[[take]]\nfolder = "seq"\nhelp = true\n')
    words_of = ["apf", "batch", str(stock / "list.toml"), "-o", str(stock / "o")]
    faults.refused(words_of, stock, "take 1: found help")


def test_a_board_without_inner_corners_is_not_printed(stock: Path) -> None:
    words_of = ["psfs", "calibrate", "--print-board", str(stock / "b.pdf"), "--squares", "2x2"]
    faults.refused(words_of, stock, "expected 3x3 or more")
