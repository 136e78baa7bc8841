"""Calibrations of other programs, damaged: one line that names the file, or the same cameras."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import tomli_w
from helpers import faults, footage
from helpers.footage import words
from helpers.fuzz import CHANGE, FUZZING, MEMORY, SECONDS, changed
from helpers.memory import limited_memory
from hypothesis import given
from hypothesis import strategies as st

from cl import InputError
from psfs.cameras.calibration import read_calibration
from psfs.cameras.camera import CameraRig


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


def qualisys(rig: CameraRig) -> dict[str, str]:
    flip, places = np.diag([1.0, -1, -1]), [f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
    rest = (
        "radialDistortion1",
        "radialDistortion2",
        "tangentalDistortion1",
        "tangentalDistortion2",
    )
    cameras = ""
    for c in rig:
        turn, (width, height) = flip @ c.R, c.size
        parts = {
            "fov_video": {"left": 0, "top": 0, "right": width - 1, "bottom": height - 1},
            "transform": dict(
                zip([*places, *"xyz"], [*turn.ravel(), *(1e3 * c.centre)], strict=True)
            ),
            "intrinsic": dict.fromkeys(rest, 0.0)
            | {"focalLengthU": 64 * c.K[0, 0], "focalLengthV": 64 * c.K[1, 1]}
            | {"centerPointU": 64 * c.K[0, 2], "centerPointV": 64 * c.K[1, 2]},
        }
        inner = "".join(
            f"<{tag} {' '.join(f'{key}={str(float(v))!r}' for key, v in of.items())}/>\n"
            for tag, of in parts.items()
        )
        cameras += f'<camera serial="{c.name}">{inner}</camera>\n'
    return {"x.qca.txt": f"<calibration><cameras>\n{cameras}</cameras></calibration>"}


def caliscope(rig: CameraRig) -> dict[str, str]:
    tables = {
        str(number): {
            "cam_id": number, "ignore": False, "size": list(c.size), "matrix": c.K.tolist(),
            "distortions": c.distortion.tolist(), "translation": c.t.tolist(),
            "rotation": c.R.tolist(),
        }
        for number, c in enumerate(rig, 1)
    }  # fmt: skip
    return {"camera_array.toml": tomli_w.dumps({"cameras": tables})}


_TSAI_NAMES = (
    *("Ncx", "Nfx", "dx", "dy", "dpx", "dpy", "Cx", "Cy", "sx", "f", "kappa1"),
    *("Tx", "Ty", "Tz", "Rx", "Ry", "Rz"),
)
#: Tsai's parameters before the pose: of the sensor, the picture's middle and the lens.
_TSAI = "768 644 0.0084 0.0098 0.01 0.0098 48 36 1 5.6 0.008"


def tsai(rig: CameraRig) -> dict[str, str]:
    return {f"{c.name}.cal": f"{_TSAI} 120 905 4210 {1.9 + k} -0.3 0.2" for k, c in enumerate(rig)}


def named_tsai(rig: CameraRig) -> dict[str, str]:
    values = {name: text.split() for name, text in tsai(rig).items()}
    lines = {name: zip(_TSAI_NAMES, of, strict=True) for name, of in values.items()}
    return {
        f"{Path(name).stem}.tsai": "\n".join(f"{key} = {value}" for key, value in of)
        for name, of in lines.items()
    }


FORMATS: dict[str, Callable[[CameraRig], dict[str, str]]] = {
    write.__name__: write
    for write in (
        *(middlebury, surrey, colmap, panoptic, humaneva, easymocap),
        *(qualisys, caliscope, tsai, named_tsai),
    )
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
@given(changes=st.lists(CHANGE, min_size=1, max_size=3), which=st.integers(0, 2))
def test_damaged_cameras(tmp_path: Path, name: str, changes: list, which: int) -> None:
    shutil.rmtree(tmp_path / "a", ignore_errors=True)
    path = written(tmp_path / "a", name)
    files = sorted((tmp_path / "a").iterdir())
    file = files[which % len(files)]
    data = file.read_bytes()
    for change in changes:
        data = changed(data, *change)
    file.write_bytes(data)
    began = time.process_time()
    with limited_memory(MEMORY):
        try:
            read(path)
        except InputError as error:
            text = str(error)
            assert str(tmp_path / "a") in text, text
            assert text.count(f"{file}: ") < 2, text
    assert time.process_time() - began < SECONDS


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("surrey", "3 1\n", "4 1\n", "expected 86 of Surrey's list of 4 cameras"),
        ("colmap", "1 0.", "1 2.", "a quaternion of length"),
        ("colmap", "cam02/", "cam01/", "camera names must differ; found cam01, cam01, cam03"),
        ("easymocap", "rows: 3", "rows: nan", "not a list of numbers"),
        ("easymocap", "cols: 3", "cols: 4", "9 numbers in 3.0 rows of 4.0; expected a matrix"),
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
