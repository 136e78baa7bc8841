"""Calibrations of other programs, damaged: one line that names the file, or the same cameras."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import faults, footage
from helpers.camera_texts import humaneva, middlebury, nerf, projections, surrey
from helpers.fuzz import check_reader

from cl import InputError
from psfs.cameras.calibration import read_calibration
from psfs.cameras.calibration.writers import (
    write_caliscope,
    write_colmap,
    write_easymocap,
    write_panoptic,
    write_qualisys,
)
from psfs.cameras.camera import CameraRig

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
    "middlebury": lambda rig: {"x_par.txt": middlebury(rig)},
    "surrey": lambda rig: {"calibration.txt": surrey(rig)},
    "humaneva": lambda rig: {f"{c.name}.cal": humaneva(c) for c in rig},
    "nerf": lambda rig: {"transforms.json": nerf(rig)},
    "projections": lambda rig: {"projections.txt": projections(rig)},
    "tsai": tsai,
    "named_tsai": named_tsai,
}


#: Formats that the product writes.
WRITERS = {
    write.__name__: write
    for write in (write_caliscope, write_colmap, write_easymocap, write_panoptic, write_qualisys)
}


def written(folder: Path, name: str) -> Path:
    """Write a rig of three cameras; return the file, or the folder, to be read."""
    folder.mkdir()
    if name in WRITERS:
        plain = [
            replace(camera, distortion=camera.distortion * (1, 1, 1, 1, 0))
            for camera in footage.rig(3)
        ]
        return WRITERS[name](folder, CameraRig(tuple(plain)))
    files = FORMATS[name](footage.rig(3))
    for file, text in files.items():
        (folder / file).write_text(text)
    return folder / next(iter(files)) if len(files) == 1 else folder


def read(path: Path) -> CameraRig:
    return read_calibration(path, sizes=lambda names: [footage.SIZE] * len(names))


@pytest.mark.parametrize("name", [*FORMATS, *WRITERS])
def test_line_ends_of_windows(tmp_path: Path, name: str) -> None:
    path = written(tmp_path / "a", name)
    expected = read(path)
    for file in filter(Path.is_file, (tmp_path / "a").rglob("*")):
        file.write_bytes(file.read_bytes().replace(b"\n", b"\r\n"))
    found = read(path)
    assert found.names == expected.names
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a.K, b.K)
        np.testing.assert_array_equal(a.R, b.R)


@pytest.mark.parametrize("name", [*FORMATS, *WRITERS])
def test_damaged_cameras(tmp_path: Path, name: str) -> None:
    path = written(tmp_path / "a", name)
    files = sorted(filter(Path.is_file, (tmp_path / "a").rglob("*")))
    check_reader(lambda: read(path), files, tmp_path / "a")


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("surrey", "3 1\n", "4 1\n", "expected 86 of Surrey's list of 4 cameras"),
        ("write_colmap", "cam02.", "cam01.", "camera names must differ; found cam01, cam01, cam03"),
        ("write_easymocap", "data:", "data: nan #", "not a list of numbers"),
    ],
)
def test_wrong_cameras(tmp_path: Path, name: str, old: str, new: str, said: str) -> None:
    path = written(tmp_path / "a", name)
    for file in filter(Path.is_file, (tmp_path / "a").rglob("*")):
        file.write_text(file.read_text().replace(old, new, 1))
    with pytest.raises(InputError) as error:
        read(path)
    assert said in str(error.value)


def test_times_in_microseconds(stock: Path) -> None:
    rows = [f"cam0{c},{k},{k * 33333}" for c in (1, 2, 3) for k in range(20)]
    file = stock / "walk/videos/timestamps.csv"
    file.write_text("\n".join(["cam_id,frame_index,frame_time", *rows]))
    faults.refused(
        ["psfs", "info", str(stock / "walk"), "--no-pictures"], stock, "expected times in s"
    )
