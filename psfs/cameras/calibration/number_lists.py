"""Read calibrations that are lists of numbers.

HumanEva and bodytrack (`.cal`), a file per camera: fc(2) cc(2) alpha kc(5 = k1 k2 p1 p2 k3) R
row-major(9) T(3), mm, x_cam = R X + T; further numbers are ignored.

Middlebury's multi-view `*_par.txt`: the number of views; each further line has the image's name, K
(9, row-major), R (9) and t (3), with P = K [R t].

Surrey (SurfCap, CVSSP3D): the numbers of cameras and of distortion coefficients; then for each
camera its first and last row, first and last column, `fx fy cx cy`, the coefficients k1, k2, ..., R
by rows (9) and t (3), with x_cam = R x + t.

A file per camera or per image (`.txt`, `.pa`, `.krt`, `.krtd`, `.cam`): K (9), R (9), t (3) and
optionally the distortion; or K (9) and [R | t] (3x4 or 4x4); or a projection matrix (3x4). Leading
words (`CONTOUR`) and comments after `#` are ignored.

Tsai's camera model (Tsai 1987; Rymut 2016, 2.2), a text file per camera in two layouts, as
Willson's programs write them: 17 numbers in the order of `_TSAI`, separated by any white space,
optionally followed by the tangential p1 p2, which must be 0; or lines `name value` or `name = value
[unit]` in any order and case, where `dpx` and `dpy` may replace the first six. Angles are radians
unless their line says `[deg]`.

With R = Rz(rz) Ry(ry) Rx(rx) and p = R x + t (eq. 2.22), a point is seen at the distorted sensor
coordinates d, mm, with f p_xy / p_z = d (1 + kappa1 |d|^2) (eq. 2.23-2.24). d is the root of a
cubic; `Camera.kappa` represents it exactly. The pixel is (sx d_x / dpx + cx, d_y / dpy + cy) (eq.
2.25-2.26, where the second sx is a misprint).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from cl import InputError
from psfs.cameras.calibration.common import (
    PLAIN,
    Calibration,
    Sizes,
    build,
    name_file_in_errors,
    parse_numbers,
    read_files,
    read_text,
)
from psfs.cameras.calibration.projections import decompose_projection, mirror_if_facing_away
from psfs.cameras.camera import MOST_CAMERAS
from psfs.cameras.units import Unit

#: Endings of files of one camera each.
SUFFIXES = (".pa", ".krt", ".krtd", ".cam", ".txt", ".p")
#: Numbers of a camera of HumanEva, and of Middlebury.
_HUMANEVA, _MIDDLEBURY = 22, 21
_WANTED = "expected K R t (21 numbers), K and [R | t] (21 or 25), or a 3x4 matrix (12)"


def read_humaneva(paths: Sequence[Path], unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read one camera per path, named after the file. Millimetres unless `unit` says otherwise."""
    return read_files(paths, _parse_humaneva, replace(PLAIN, unit="mm"), unit, sizes)


def _parse_humaneva(path: Path) -> dict[str, Any]:
    values = parse_numbers(read_text(path).replace(",", " ").split(), "HumanEva calibration")
    if values.size < _HUMANEVA:
        raise InputError(f"{values.size} numbers; expected at least {_HUMANEVA} (HumanEva)")
    fx, fy, cx, cy, alpha = values[:5]
    K = [fx, alpha * fx, cx, 0, fy, cy, 0, 0, 1]
    return {"K": K, "distortion": values[5:10], "R": values[10:19], "t": values[19:_HUMANEVA]}


def read_camera_files(paths: Sequence[Path], unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read one camera per path, named after the file. Metres unless `unit` says otherwise."""
    counts: list[int] = []

    def parse(path: Path) -> dict[str, Any]:
        values = _read_numbers(path)
        counts.append(values.size)
        return _split_numbers(values)

    rig = read_files(paths, parse, PLAIN, unit, sizes)
    return mirror_if_facing_away(rig) if set(counts) == {12} else rig


def _split_numbers(values: np.ndarray) -> dict[str, Any]:
    """Return what 12, 21, 25 or more numbers are. Raises InputError for other counts."""
    count = values.size
    if count == 12:
        return decompose_projection("camera", values.reshape(3, 4))
    if count not in (21, 25) and not 23 <= count <= 21 + 14:
        raise InputError(f"{count} numbers; {_WANTED}")
    K, rest = values[:9].reshape(3, 3), values[9:]
    if abs(K[2]).max() == 0:
        raise InputError(f"the last row of K is zero; {_WANTED}")
    distortion = np.zeros(0)
    joint = rest[:12].reshape(3, 4)
    homogeneous = count == 25 and np.allclose(rest[12:], [0, 0, 0, 1])
    rotation = np.abs(joint[:, :3] @ joint[:, :3].T - np.eye(3)).max() < 1e-3
    if not homogeneous and not (count == 21 and rotation):
        joint = np.column_stack([rest[:9].reshape(3, 3), rest[9:12]])
        distortion = rest[12:]
    return {"K": K / K[2, 2], "distortion": distortion, "R": joint[:, :3], "t": joint[:, 3]}


def _read_numbers(path: Path) -> np.ndarray:
    """Read all numbers (N,) of a file, after leading words."""
    lines = [line.split("#")[0].replace(",", " ").split() for line in read_text(path).splitlines()]
    words = [word.strip("[];") for line in lines for word in line]
    while words and not _is_number(words[0]):
        words.pop(0)
    return parse_numbers([word for word in words if word], "a camera")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def read_middlebury(path: Path, unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read the cameras in the order of the file, named after their images without suffix.

    Metres unless `unit` says otherwise. No distortion.
    """
    with name_file_in_errors(path):
        lines = [line.split() for line in read_text(path).splitlines() if line.strip()]
        promised = " ".join(lines.pop(0)) if lines else "nothing"
        if promised != str(len(lines)):
            raise InputError(f"{len(lines)} views; the first line promises {promised}")
        records = []
        for name, *words in lines:
            view = Path(name).stem
            if len(words) != _MIDDLEBURY:
                raise InputError(f"view {view}: {len(words)} numbers; expected {_MIDDLEBURY}")
            K, R, t = np.split(parse_numbers(words, f"view {view}"), [9, 18])
            records.append((view, {"K": K / K[8], "distortion": [], "R": R, "t": t}))
        return build(PLAIN, records, unit, sizes)


def looks_like_surrey(text: str) -> bool:
    """Return whether the first line states the numbers of cameras and of coefficients."""
    words = text.lstrip().partition("\n")[0].split()
    try:
        count, order = map(int, words)
    except ValueError:
        return False
    return 0 < count <= MOST_CAMERAS and 0 <= order <= 5


def read_surrey(path: Path, unit: Unit | None) -> Calibration:
    """Read the cameras, named cam01, cam02, ... Metres unless `unit` says otherwise."""
    with name_file_in_errors(path):
        text = read_text(path)
        if not looks_like_surrey(text):
            raise InputError("expected Surrey's list, which begins with two numbers in a line")
        values = parse_numbers(text.split(), "Surrey's calibration")
        order, needed = int(values[1]), int(2 + values[0] * (20 + values[1]))
        if len(values) != needed:
            raise InputError(
                f"{len(values)} numbers; expected {needed} of Surrey's list of {values[0]:.0f} "
                f"cameras with {order} coefficients"
            )
        rows = values[2:].reshape(int(values[0]), 20 + order)
        names = [f"cam{index:02d}" for index in range(1, len(rows) + 1)]
        records = [(name, _split_surrey(name, row)) for name, row in zip(names, rows, strict=True)]
        return build(PLAIN, records, unit, None)


def _split_surrey(name: str, row: np.ndarray) -> dict[str, Any]:
    (top, last_row, left, last_column), (fx, fy, cx, cy), radial, R, t = np.split(
        row, [4, 8, len(row) - 12, len(row) - 3]
    )
    if top or left:
        raise InputError(f"{name}: the picture begins at {left:g}, {top:g}, not 0, 0")
    if radial[3:].any():
        raise InputError(f"{name}: {len(radial)} radial coefficients; expected at most 3")
    k1, k2, k3 = np.append(radial, np.zeros(3))[:3]
    size = last_column + 1, last_row + 1
    K = [fx, 0, cx, 0, fy, cy, 0, 0, 1]
    return {"K": K, "distortion": [k1, k2, 0, 0, k3], "R": R, "t": t, "size": size}


TSAI = (".cpar", ".tsai")
_TSAI = (
    *("ncx", "nfx", "dx", "dy", "dpx", "dpy", "cx", "cy", "sx"),
    *("f", "kappa1", "tx", "ty", "tz", "rx", "ry", "rz"),
)
_SENSOR_NAMES = ("ncx", "nfx", "dx", "dy")
_TSAI_LINE = re.compile(r"^\s*(\w+)\s*[=:\s]\s*([-+.\deE]+)\s*(?:\[?\s*(\S*?)\s*\]?)\s*$")


def looks_like_tsai(text: str) -> bool:
    """Return whether the text has one of the two layouts."""
    words = text.split()
    named = {match[1].lower() for match in map(_TSAI_LINE.match, text.splitlines()) if match}
    if {"kappa1", "f", "tz", "rz"} <= named:
        return True
    try:
        values = [float(word) for word in words]
    except ValueError:
        return False
    return len(values) in (len(_TSAI), len(_TSAI) + 2) and not any(values[len(_TSAI) :])


def read_tsai(paths: Sequence[Path], unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read one camera per path, named after the file. Millimetres unless `unit` says otherwise."""
    return read_files(paths, _parse_tsai, PLAIN, unit or "mm", sizes)


def _parse_parameters(text: str) -> Mapping[str, float]:
    """Parse the parameters by name. Raises InputError if one is missing or not a number."""
    if not looks_like_tsai(text):
        count = len(text.split())
        raise InputError(
            f"{count} words; expected Tsai's {len(_TSAI)} numbers ({', '.join(_TSAI)}), with p1 "
            "and p2 0 if they follow, or lines of name and value"
        )
    lines = [match for match in map(_TSAI_LINE.match, text.splitlines()) if match]
    if not lines:
        numbers = parse_numbers(text.split(), "Tsai's calibration")
        values = dict(zip(_TSAI, numbers.tolist(), strict=False))
    else:
        values = {}
        for name, number, unit in (match.groups() for match in lines):
            value = float(parse_numbers([number], f"Tsai's {name}")[0])
            angle = name.lower() in ("rx", "ry", "rz") and unit.lower().startswith("deg")
            values[name.lower()] = np.radians(value) if angle else value
    if "dpx" not in values and {"dx", "ncx", "nfx"} <= values.keys() and values["nfx"]:
        values["dpx"] = values["dx"] * values["ncx"] / values["nfx"]
    values.setdefault("dpy", values.get("dy", 0.0))
    missing = [name for name in _TSAI if name not in values and name not in _SENSOR_NAMES]
    if missing:
        raise InputError(f"Tsai's calibration lacks {', '.join(missing)}")
    return values


def _parse_tsai(path: Path) -> dict[str, Any]:
    values = _parse_parameters(read_text(path))
    f, dpx, dpy, sx = (values[key] for key in ("f", "dpx", "dpy", "sx"))
    if not (f > 0 and dpx > 0 and dpy > 0 and sx > 0):
        raise InputError(f"f {f:g}, dpx {dpx:g}, dpy {dpy:g}, sx {sx:g}; expected positive numbers")
    angles = [values[key] for key in ("rx", "ry", "rz")]
    return {
        "K": [sx * f / dpx, 0, values["cx"], 0, f / dpy, values["cy"], 0, 0, 1],
        "distortion": [],
        "R": scipy.spatial.transform.Rotation.from_euler("xyz", angles).as_matrix(),
        "t": [values["tx"], values["ty"], values["tz"]],
        "kappa": values["kappa1"] * f**2,
    }
