"""Errors of invalid calibrations: one line with file, camera and what was expected."""

from collections.abc import Callable
from pathlib import Path

import pytest
from helpers import footage

from cl import InputError
from psfs.cameras.calibration import read_calibration


def _toml_with(change: Callable[[dict], object]) -> str:
    import tomli_w

    tables = footage.tables(footage.rig(2))
    change(tables["cam02"])
    return tomli_w.dumps(tables)


BROKEN = [
    (
        "c.toml",
        _toml_with(lambda t: t.update(matrix=[[1.0, 2.0], [3.0]])),
        "expected a list of numbers",
    ),
    ("c.toml", _toml_with(lambda t: t.update(distortions=[0.1] * 8)), "at most 5"),
    ("c.toml", _toml_with(lambda t: t.update(distortions="none")), "cam02: distortions"),
    (
        "c.toml",
        _toml_with(lambda t: t.update(translation=[0.0, float("inf"), 1.0])),
        "not finite",
    ),
    ("c.toml", _toml_with(lambda t: t.update(size=["a", "b"])), "size"),
    ("c.toml", "[cam01\nname = 3", "malformed TOML"),
    ("c.toml", "title = 'nothing'", "no camera tables"),
    ("c.cal", "1 2 3", "3 numbers; expected at least 22"),
    ("c.cal", "1 2 x", "found 'x'"),
    ("c.cal", "500 500 32 24 0 0 0 0 0 0 1 0 0 0 1 0 0 0 -2 0 0 0", "R is not a rotation"),
    ("c.cal", "500 500 32 24 0 0 0 0 0 0 1 0 0 0 nan 0 0 0 1 0 0 0", "not finite"),
    ("c.xml", "<?xml version='1.0'?><opencv_storage><a></opencv_storage>", "malformed"),
    ("c.yml", "%YAML:1.0\n---\nsomething: 3\n", "no CameraMatrix"),
    ("c.json", "", "c.json"),
    ("x_par.txt", "1\na.png 1 2 3", "view a: 3 numbers; expected 21"),
    ("x_par.txt", "4\na.png " + "1 " * 21, "1 views; the first line promises 4"),
    ("p.txt", "cam 1 2 3", "expected 12"),
    ("p.txt", "cam " + "1 " * 12, "singular"),
    ("p.txt", "cam nan " + "1 " * 11, "not finite"),
    ("p.txt", "", "no projection matrix"),
]


@pytest.mark.parametrize(("name", "text", "expected"), BROKEN)
def test_broken(tmp_path: Path, name: str, text: str, expected: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_calibration(path, sizes=(64, 48))
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
