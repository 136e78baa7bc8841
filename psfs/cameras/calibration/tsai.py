"""Read Tsai's camera model (Tsai 1987; Rymut 2016, 2.2), one text file per camera.

Two layouts, as Willson's programs write them: 17 numbers in the order of `_NAMES`, separated by any
white space, optionally followed by the tangential p1 p2, which must be 0; or lines `name value` or
`name = value [unit]` in any order and case, where `dpx` and `dpy` may replace the first six. Angles
are radians unless their line says `[deg]`.

With R = Rz(rz) Ry(ry) Rx(rx) and p = R x + t (eq. 2.22), a point is seen at the distorted sensor
coordinates d, mm, with f p_xy / p_z = d (1 + kappa1 |d|^2) (eq. 2.23-2.24). d is the root of a
cubic; `Camera.kappa` represents it exactly. The pixel is (sx d_x / dpx + cx, d_y / dpy + cy) (eq.
2.25-2.26, where the second sx is a misprint).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from cl import InputError
from psfs.cameras.calibration.common import (
    PLAIN,
    Calibration,
    Sizes,
    parse_numbers,
    read_files,
    read_text,
)
from psfs.cameras.units import Unit

SUFFIXES = (".cpar", ".tsai")
_NAMES = (
    *("ncx", "nfx", "dx", "dy", "dpx", "dpy", "cx", "cy", "sx"),
    *("f", "kappa1", "tx", "ty", "tz", "rx", "ry", "rz"),
)
_SENSOR_NAMES = ("ncx", "nfx", "dx", "dy")
_LINE = re.compile(r"^\s*(\w+)\s*[=:\s]\s*([-+.\deE]+)\s*(?:\[?\s*(\S*?)\s*\]?)\s*$")


def looks_like_tsai(text: str) -> bool:
    """Return whether the text has one of the two layouts."""
    words = text.split()
    named = {match[1].lower() for match in map(_LINE.match, text.splitlines()) if match}
    if {"kappa1", "f", "tz", "rz"} <= named:
        return True
    try:
        values = [float(word) for word in words]
    except ValueError:
        return False
    return len(values) in (len(_NAMES), len(_NAMES) + 2) and not any(values[len(_NAMES) :])


def read_tsai(paths: Sequence[Path], unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read one camera per path, named after the file. Millimetres unless `unit` says otherwise."""
    return read_files(paths, _parse_camera, PLAIN, unit or "mm", sizes)


def _parse_parameters(text: str) -> Mapping[str, float]:
    """Parse the parameters by name. Raises InputError if one is missing or not a number."""
    if not looks_like_tsai(text):
        count = len(text.split())
        raise InputError(
            f"{count} words; expected Tsai's {len(_NAMES)} numbers ({', '.join(_NAMES)}), with p1 "
            "and p2 0 if they follow, or lines of name and value"
        )
    lines = [match for match in map(_LINE.match, text.splitlines()) if match]
    if not lines:
        numbers = parse_numbers(text.split(), "Tsai's calibration")
        values = dict(zip(_NAMES, numbers.tolist(), strict=False))
    else:
        values = {}
        for name, number, unit in (match.groups() for match in lines):
            value = float(parse_numbers([number], f"Tsai's {name}")[0])
            angle = name.lower() in ("rx", "ry", "rz") and unit.lower().startswith("deg")
            values[name.lower()] = np.radians(value) if angle else value
    if "dpx" not in values and {"dx", "ncx", "nfx"} <= values.keys() and values["nfx"]:
        values["dpx"] = values["dx"] * values["ncx"] / values["nfx"]
    values.setdefault("dpy", values.get("dy", 0.0))
    missing = [name for name in _NAMES if name not in values and name not in _SENSOR_NAMES]
    if missing:
        raise InputError(f"Tsai's calibration lacks {', '.join(missing)}")
    return values


def _parse_camera(path: Path) -> dict[str, Any]:
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
