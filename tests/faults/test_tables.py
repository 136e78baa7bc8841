"""Calibrations, settings and bodies with every value replaced by every kind of wrong one."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from helpers import faults, footage
from helpers.faults import WRONG, refused

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

NUMBERS: dict[str, Any] = {
    "a skewed row": ("matrix", [[60, 0, 31], [5, 60, 23], [0, 0, 1]], "intrinsic matrix"),
    "K[2][2] is 2": ("matrix", [[60, 0, 31], [0, 60, 23], [0, 0, 2]], "intrinsic matrix"),
    "no focal length": ("matrix", [[0, 0, 31], [0, 60, 23], [0, 0, 1]], "focal lengths"),
    "a huge one": ("matrix", [[1e10, 0, 31], [0, 60, 23], [0, 0, 1]], "expected up to"),
    "no width": ("size", [0, 48], "size 0 x 48"),
    "half a pixel": ("size", [64.5, 48], "whole numbers"),
    "a huge picture": ("size", [100_000, 100_000], "size 100000 x 100000"),
    "NaN": ("translation", [0.0, float("nan"), 1.0], "translation holds a number that is not fin"),
    "far away": ("translation", [1e10, 0, 0], "expected up to"),
    "no rotation": ("rotation", [[2, 0, 0], [0, 1, 0], [0, 0, 1]], "not a rotation"),
    "eight numbers": ("rotation", [1.0] * 8, "expected 3 (Rodrigues) or 9 (a matrix)"),
    "a path": ("name", "../../../evil", "'/'"),
    "a backslash": ("name", "a\\b", "a camera has the name"),
    "an escape": ("name", "a\x1b[31mb", "a camera has the name"),
    "a long name": ("name", "x" * 300, "300 characters"),
    "the name of another": ("name", "cam01", "names must differ"),
    "fisheye": ("fisheye", 3, "fisheye"),
    **{
        f"{n} distortions": ("distortions", [0.01] * n, f"cam02: {n} distortion coefficients; ex")
        for n in (3, 6, 7, 8)
    },
    **{
        f"no {key}": (key, None, key)
        for key in ("matrix", "distortions", "rotation", "translation")
    },
}


@pytest.mark.parametrize("fault", NUMBERS)
def test_a_camera_that_cannot_be(stock: Path, fault: str) -> None:
    key, value, said = NUMBERS[fault]
    tables = footage.tables(footage.rig(3))
    tables["cam02"][key] = value
    if value is None:
        del tables["cam02"][key]
    footage.write_toml(stock / "walk/calibration.toml", tables)
    words = ["psfs", "info", str(stock / "walk"), "--no-pictures"]
    refused(words, stock, "calib", said)


STORED: dict[str, tuple[str, bytes]] = {
    "deep yml": ("c.yml", b"%YAML:1.0\n---\na: " + b"[" * 100_000),
    "deep block yml": ("c.yml", b"%YAML:1.0\n---\n" + b"".join(
        b" " * i + b"a:\n" for i in range(2000))),
    "deep json": ("c.json", b'{"a":' * 100_000),
    "deep xml": ("c.xml", b"<?xml version='1.0'?><opencv_storage>" + b"<a>" * 100_000),
    "a list": ("c.json", b"[1, 2]"),
    "no matrix": ("c.yml", b"%YAML:1.0\n---\nCameraMatrix: 3\n"),
    "tables for numbers": ("c.json", b'{"CameraMatrix": {"a": 1}, "D": [], "R": [], "T": []}'),
    "a matrix that lies": ("c.yml", b"%YAML:1.0\n---\nCameraMatrix: !!opencv-matrix\n   rows: 99999"
                           b"\n   cols: 99999\n   dt: d\n   data: [ 1. ]\n"),
    "a wrong type": ("c.yml", b"%YAML:1.0\n---\nCameraMatrix: !!opencv-matrix\n   rows: 1\n"
                     b"   cols: 1\n   dt: qq\n   data: [ 1. ]\n"),
    "a cut file": ("c.xml", b"<?xml version='1.0'?><opencv_storage><CameraMatrix type_id='opencv"),
    "binary": ("c.yml", bytes(range(256)) * 10),
}  # fmt: skip


@pytest.mark.parametrize("fault", STORED)
def test_filestorage_files(stock: Path, fault: str) -> None:
    name, content = STORED[fault]
    (stock / "walk" / name).write_bytes(content)
    calibration = ["--calibration", str(stock / "walk" / name)]
    refused(["psfs", "info", str(stock / "walk"), *calibration], stock, name)


BOUNDS = {
    "background": ['"x"'],
    "fps": ['"fast"', "0", "-1", "1e-300", "1e300", "100001"],
    "threshold": ["0", "1", "-0.5", "2"],
    "dilate": ["-1", "1001", "1.5"],
    "unit": ["0", "-1", "1e-300", '"0mm"', '"1e300m"', '"-3cm"', '"inch"', '"1e"'],
    "volume": ["[[0,0,0],[0,1,1]]", "[[1,1,1],[0,0,0]]", "[[-1e9,0,0],[1e9,1,1]]", "[0,0,0,1,1]"],
    "cameras": ['["cam01", "cam01"]', '["cam99"]', '["../cam01"]', "[1, 2]", '"cam01"'],
    "calibration": ['"/no/such/file"', '"../../../../etc/passwd"', '"x\\u0000y"'],
    "up": ['"w"', '"zz"', '"up"'],
    "key": ['"#12345"', '"#gggggg"', '"green"'],
    "nonsense": ["1", '"x"'],
}


@pytest.mark.parametrize("key", BOUNDS)
def test_settings_out_of_bounds(stock: Path, key: str) -> None:
    for value in BOUNDS[key]:
        (stock / "walk/sequence.toml").write_text(f"{key} = {value}\n")
        said = "camera" if key == "cameras" else key
        refused(["psfs", "info", str(stock / "walk"), "--no-pictures"], stock, str(stock), said)


def body_words(stock: Path) -> list[str]:
    body = ["--body", str(stock / "track/body.toml")]
    return ["apf", "track", str(stock / "seq"), "-o", str(stock / "new"), *body]


def longer(factor: float) -> Callable[[dict], None]:
    def change(body: dict) -> None:
        for bone in body["bone"]:
            bone["offset"] = [factor * value for value in bone.get("offset", [0, 0, 0])]
        for cone in body["cone"]:
            for key in ("start", "end"):
                cone[key] = [factor * value for value in cone[key]]

    return change


BODIES: dict[str, tuple[Callable[[dict], Any], str]] = {
    "17 m tall": (longer(10.0), "expected"),
    "1000 bones": (lambda b: b.update(bone=b["bone"] * 100), "bone"),
    "a bone twice": (lambda b: b["bone"].append(b["bone"][1]), "same name"),
    "no joints": (lambda b: b.pop("joint"), "joint"),
    "an unknown key": (lambda b: b["bone"][0].update(ofset=[0, 0, 0]), "ofset"),
    "a path as a name": (lambda b: b["joint"][0].update(name="../evil"), "'/'"),
    "its own parent": (
        lambda b: b["bone"][1].update(parent=b["bone"][1]["name"]),
        "a bone before it",
    ),
    "limits reversed": (lambda b: b["bone"][1]["axes"][0].update(limits=[1, -1]), "lower limit"),
    "an index twice": (lambda b: b["bone"][1]["axes"][0].update(dof=0), "indices"),
    "a negative radius": (lambda b: b["cone"][0].update(radii=[0.1, -0.1]), "radii"),
    "a point as a cone": (lambda b: b["cone"][0].update(end=b["cone"][0]["start"]), "length"),
}


@pytest.mark.parametrize("fault", BODIES)
def test_a_body_that_cannot_be(stock: Path, fault: str) -> None:
    change, said = BODIES[fault]
    path = stock / "track/body.toml"
    body = tomllib.loads(path.read_text())
    change(body)
    path.write_text(tomli_w.dumps(body))
    refused(body_words(stock), stock, said)


SUMMARY: list[tuple[str | int, ...]] = [
    (),
    ("sequence",),
    ("sequence", "absolute"),
    ("sequence", "overrides"),
    ("sequence", "cameras"),
    ("grid",),
    ("grid", "origin_m"),
    ("grid", "voxel_size_m"),
    ("grid", "shape"),
    ("config",),
    ("frames",),
    ("frames", 0),
    ("frames", 0, "index"),
    ("frames", 0, "surface_voxels"),
]


@pytest.mark.parametrize("at", SUMMARY, ids=str)
def test_a_summary_with_a_wrong_value(stock: Path, at: tuple) -> None:
    path = stock / "out/summary.json"
    good = json.loads(path.read_text())
    for kind, value in WRONG.items():
        if kind == "a date" or (kind == "a table" and not at):
            continue
        path.write_text(json.dumps(faults.replaced(good, at, value)))
        refused(["psfs", "mesh", str(stock / "out")], stock, str(stock / "out"))


def test_other_summaries(stock: Path) -> None:
    path = stock / "out/summary.json"
    good = json.loads(path.read_text())
    frames = good["frames"]
    for value, said in (
        ([], "no reconstructed frame"),
        (frames[::-1], "evenly spaced"),
        ([*frames, frames[-1]], "evenly spaced"),
        ([{**frames[0], "index": 10**9}], "expected the same sequence"),
    ):
        path.write_text(json.dumps({**good, "frames": value}))
        refused(["psfs", "check", str(stock / "out")], stock, "out", said)
    for text in ("", "[1", '{"a":' * 100_000, "null", "\0", '{"a": 1' + "0" * 5000 + "}"):
        path.write_text(text)
        refused(["psfs", "check", str(stock / "out")], stock, "summary.json")
