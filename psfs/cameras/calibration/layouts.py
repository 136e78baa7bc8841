"""Read the calibrations of many programs by one table, which says where each puts what.

A file is parsed to records, one per camera: tables of JSON, YAML and MATLAB as they are, lists of
numbers under the names of their parts. `LAYOUTS` says which keys of a record are the intrinsic
matrix, the distortion, the pose and the size, in which unit and which direction.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cl import InputError
from psfs.cameras.calibration.common import (
    Calibration,
    Layout,
    Record,
    Sizes,
    build,
    name_file_in_errors,
    parse_numbers,
    read_text,
)
from psfs.cameras.calibration.filestorage import read_storage
from psfs.cameras.calibration.projections import read_variables
from psfs.cameras.names import join_names
from psfs.cameras.units import Unit
from psfs.common.files import read_json

LAYOUTS = (
    Layout("CMU Panoptic", "K", ("distCoef",), "R", "t", size=("resolution",), unit="cm"),
    Layout(
        "AIST++", "matrix", ("distortions",), "rotation", "translation", size=("size",), unit="cm"
    ),
    Layout(
        "multical", "K", ("dist",), "R", "T", size=("image_size",),
        lens=("model", ("standard",), ("fisheye",)),
    ),
    Layout(
        "MC-Calib", "camera_matrix", ("distortion_vector",), pose="camera_pose_matrix",
        size=("img_width", "img_height"), pose_of="camera", lens=("distortion_type", (0,), (1,)),
    ),
    Layout(
        "Kalibr", "intrinsics", ("distortion_coeffs",), pose="T_cn_cnm1", size=("resolution",),
        pose_of="neighbour",
        lens=("lens", ("pinhole-radtan", "pinhole-none"), ("pinhole-equidistant",)),
    ),
    Layout(
        "JARVIS", "intrinsicMatrix", ("distortionCoefficients",), "R", "T", unit="mm",
        by_columns=True, file=r"(?:Calib_)?(.+)\.\w+",
    ),
    Layout(
        "DANNCE", "K", ("RDistort", "TDistort"), "r", "t", unit="mm", by_columns=True,
        file=r"(?:hires_)?(.+?)(?:_params)?\.mat",
    ),
    Layout(
        "bioCV", "K", ("bioCV",), pose="pose", size=("size",), unit="mm",
        file=r"(.+?)(?:\.(?:mp4|avi|mov))?\.calib",
    ),
    Layout(
        "Skeletool", "intrinsic", ("radial",), pose="extrinsic", size=("size",), unit="mm"
    ),
    Layout("numbered cameras", "K", ("k1 k2",), pose="pose"),
)  # fmt: skip


#: Most keys that an error shows.
_SHOWN = 12


def read_layout(paths: Sequence[Path], unit: Unit | None, sizes: Sizes) -> Calibration | None:
    """Read one file with all cameras, or a file per camera; None if they have no known layout.

    Raises InputError naming file and camera.
    """
    if len({path.suffix.lower() for path in paths}) != 1:
        return None
    contents = [_parse(path) for path in paths]
    if len(paths) == 1:
        with name_file_in_errors(paths[0]):
            records = _find_records(contents[0])
        layouts = [layout for layout in LAYOUTS if records and layout.fits([*records.values()])]
    else:
        layouts = [layout for layout in LAYOUTS if layout.fits(contents)]
        names = [_name_camera(path, layouts) for path in paths]
        records = dict(zip(names, contents, strict=True))
    if not layouts and len(paths) == 1 and records and "" not in records:
        keys = sorted({key for record in records.values() for key in record})
        raise InputError(
            f"{paths[0]}: cameras {join_names(records)} with {join_names(keys[:_SHOWN])}; expected "
            f"the keys of {join_names(layout.program for layout in LAYOUTS)}"
        )
    if not layouts:
        return None
    if len(paths) == 1 and list(records) == [""]:
        records = {_name_camera(paths[0], layouts): records[""]}
    with name_file_in_errors(paths[0] if len(paths) == 1 else paths[0].parent):
        return build(layouts[0], records.items(), unit, sizes)


def _name_camera(path: Path, layouts: Sequence[Layout]) -> str:
    match = re.fullmatch(layouts[0].file, path.name, re.IGNORECASE) if layouts else None
    return match[1] if match else path.stem


def _find_records(content: Any) -> dict[str, Record]:
    """Return what a file says of each camera: of a list or table of tables, under `cameras` or at
    the top, with poses beside them; of one camera under the empty name."""
    cameras = content.get("cameras", content) if isinstance(content, Mapping) else content
    if isinstance(cameras, Mapping):
        tables = {
            str(k): v for k, v in cameras.items() if isinstance(v, Mapping) and "rows" not in v
        }
        tables.pop("camera_poses", None)
        records = tables or {"": cameras}
    else:
        listed = [entry for entry in cameras if isinstance(entry, Mapping)] if cameras else []
        records = {str(row.get("name", f"cam{n:02d}")): row for n, row in enumerate(listed, 1)}
        if len(records) < len(listed):
            raise InputError("camera names must differ; found the same name twice")
    poses = content.get("camera_poses") if isinstance(content, Mapping) else None
    if isinstance(poses, Mapping):  # of multical: cam01, cam02_to_cam01, ...
        for name, pose in poses.items():
            camera = str(name).split("_to_")[0]
            if camera in records and isinstance(pose, Mapping):
                records[camera] = {**records[camera], **pose}
    return {_find_name(name, record): record for name, record in records.items()}


def _find_name(name: str, record: Record) -> str:
    """Return the camera's name: in the topic from which it was recorded, as Kalibr says, else that
    of its table; camera_0 for a number."""
    name = f"camera_{name}" if name.isdecimal() else name
    topic = [part for part in str(record.get("rostopic", "")).split("/") if part]
    return topic[-2] if len(topic) > 1 else topic[0] if topic else name


def _parse(path: Path) -> Any:
    """Return the content of a file as tables, lists and numbers; an empty table if it is none."""
    suffix = path.suffix.lower()
    if suffix == ".json":
        return read_json(path, "a calibration") or {}
    if suffix == ".mat":
        with name_file_in_errors(path):
            return read_variables(path)
    text = read_text(path)
    with name_file_in_errors(path):
        if suffix in (".yml", ".yaml") and not text.startswith("%YAML"):
            return _parse_plain_yaml(text)
        if suffix in (".xml", ".yml", ".yaml"):
            return read_storage(path)
        if text.startswith("Skeletool"):
            return _parse_skeletool(text)
        return _parse_numbers(text, suffix)


def _parse_plain_yaml(text: str) -> dict[str, dict[str, Any]]:
    """Parse tables of one level, whose values are in one line or rows of numbers below the key."""
    records: dict[str, dict[str, Any]] = {}
    record: dict[str, Any] = {}
    key = ""
    for line in text.splitlines():
        indented, words = line[:1] in " -", line.strip()
        if not words or words.startswith("#"):
            continue
        if words.startswith("- ") and key:
            record[key] = [*(record[key] or []), _parse_value(words[2:])]
        elif not indented and words.endswith(":"):
            record = records.setdefault(words[:-1], {})
        else:
            key, _, value = words.partition(":")
            record[key] = _parse_value(value.strip())
    for record in records.values():
        if {"camera_model", "distortion_model"} <= record.keys():
            record["lens"] = f"{record['camera_model']}-{record['distortion_model']}"
    return records


def _parse_value(text: str) -> Any:
    try:
        return json.loads(text) if text else None
    except (ValueError, RecursionError):
        return text


def _parse_skeletool(text: str) -> dict[str, dict[str, Any]]:
    """Parse sections of lines `key values`, each beginning with `name`."""
    records: dict[str, dict[str, Any]] = {}
    record: dict[str, Any] = {}
    for words in filter(None, map(str.split, text.splitlines()[1:])):
        if words[0] == "name":
            record = records.setdefault(" ".join(words[1:]), {})
        elif words[0] in ("size", "intrinsic", "extrinsic", "radial"):
            record[words[0]] = parse_numbers(words[1:], words[0])
            if words[0] == "radial" and record["radial"].any():
                raise InputError("a radial distortion; expected undistorted cameras, radial 0")
    return records


#: Numbers of bioCV's camera: size, K, pose, distortion; of a numbered one: K, k1 k2, [R | t].
_BIOCV, _NUMBERED = 2 + 9 + 16, 1 + 9 + 2 + 12


def _parse_numbers(text: str, suffix: str) -> dict[str, Any]:
    """Parse files that hold numbers only; an empty table for any others."""
    try:
        values = parse_numbers(text.split(), "a camera")
    except InputError:
        return {}
    if suffix == ".calib" and _BIOCV + 4 <= len(values) <= _BIOCV + 5:
        size, K, pose, bent = np.split(values, [2, 11, _BIOCV])
        return {"size": size, "K": K, "pose": pose, "bioCV": bent}
    lines = [len(line.split()) for line in text.splitlines() if line.strip()]
    if len(values) % _NUMBERED or lines[:8] != [1, 3, 3, 3, 2, 4, 4, 4]:
        return {}
    rows = values.reshape(-1, _NUMBERED)
    return {
        f"{int(row[0])}": {"K": row[1:10], "k1 k2": row[10:12], "pose": row[12:]} for row in rows
    }
