"""Calibrations of other programs, damaged: one line that names the file, or the same cameras."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers import faults, footage
from helpers.camera_programs import PROGRAMS
from helpers.camera_texts import FORMATS, Files, write_files
from helpers.fuzz import check_reader

from cl import InputError
from psfs.cameras.calibration import read_calibration
from psfs.cameras.camera import CameraRig

_TSAI = {
    "Ncx": 768, "Nfx": 644, "dx": 0.0084, "dy": 0.0098, "dpx": 0.01, "dpy": 0.0098, "Cx": 48,
    "Cy": 36, "sx": 1, "f": 5.6, "kappa1": 0.008, "Tx": 120, "Ty": 905, "Tz": 4210, "Rx": 1.9,
    "Ry": -0.3, "Rz": 0.2,
}  # fmt: skip


def tsai(rig: CameraRig) -> Files:
    return {f"{name}.cal": " ".join(map(str, _TSAI.values())) for name in rig.names}


def named_tsai(rig: CameraRig) -> Files:
    text = "\n".join(f"{key} = {value}" for key, value in _TSAI.items())
    return {f"{name}.tsai": text for name in rig.names}


#: Formats with a reader each; those of Tsai say another lens.
WRITERS: dict[str, Callable[[CameraRig], Files]] = {
    **FORMATS, **PROGRAMS, "tsai": tsai, "named_tsai": named_tsai
}  # fmt: skip


BINARY = {"matlab_cells", "matlab_stacks", "dannce", "colmap_binary"}


def written(folder: Path, name: str) -> Path:
    """Write a rig of three cameras; return the file, or the folder, to be read."""
    files = write_files(folder, WRITERS[name](footage.rig(3)))
    return files[0] if len(files) == 1 else folder


def read(path: Path) -> CameraRig:
    return read_calibration(path, sizes=lambda names: [footage.SIZE] * len(names))


@pytest.mark.parametrize("name", sorted(WRITERS.keys() - BINARY))
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


@pytest.mark.parametrize("name", WRITERS)
def test_damaged_cameras(tmp_path: Path, name: str) -> None:
    path = written(tmp_path / "a", name)
    files = sorted(filter(Path.is_file, (tmp_path / "a").rglob("*")))
    check_reader(lambda: read(path), files, tmp_path / "a")


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("surrey", "3 1\n", "4 1\n", "expected 86 of Surrey's list of 4 cameras"),
        ("colmap", "cam02/", "cam01/", "camera names must differ; found cam01, cam01, cam03"),
        ("easymocap", "data:", "data: nan #", "not a list of numbers"),
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
