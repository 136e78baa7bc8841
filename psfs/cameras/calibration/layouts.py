"""Read the calibrations of many programs by one table, which says where each puts what.

A file is parsed to records, one per camera: tables of JSON, YAML and MATLAB as they are, lists of
numbers under the names of their parts. `LAYOUTS` says which keys of a record are the intrinsic
matrix, the distortion, the pose and the size, in which unit and which direction.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cl import InputError
from psfs.cameras.calibration.common import (
    Calibration,
    Size,
    Sizes,
    check_whole_size,
    convert_to_metres,
    find_sizes,
    name_file_in_errors,
    parse_array,
    parse_numbers,
    parse_rotation,
    read_text,
)
from psfs.cameras.calibration.filestorage import Storage
from psfs.cameras.calibration.matlab import read_variables
from psfs.cameras.camera import MOST_CAMERAS, Camera, CameraRig
from psfs.cameras.names import join_names, natural_key
from psfs.cameras.units import Unit
from psfs.common.files import read_json

#: What a file says of one camera, by key.
Record = Mapping[str, Any]


@dataclass(frozen=True)
class Layout:
    """Where a program's records have what.

    K: fx fy cx cy, or a matrix. distortion: keys whose numbers follow each other: k1 k2 p1 p2 k3.
    R and t, or pose, a matrix of 3x4 or 4x4. size: one key with width and height, or two. unit: of
    lengths. by_columns: whether matrices are stored by columns. pose_of: what the pose maps: the
    world to the camera, back, or the camera before to this one. lens: a key with the values that
    say OpenCV's lens and its fisheye lens; other values are refused. file: what of a file's name
    is the camera's.
    """

    program: str
    K: str
    distortion: tuple[str, ...]
    R: str = ""
    t: str = ""
    pose: str = ""
    size: tuple[str, ...] = ()
    unit: Unit = "m"
    by_columns: bool = False
    pose_of: Literal["world", "camera", "neighbour"] = "world"
    lens: tuple[str, tuple[object, ...], tuple[object, ...]] = ("", (), ())
    file: str = r"(.+)\.\w+"

    def fits(self, records: Sequence[Record]) -> bool:
        """Return whether all records have the keys of this layout."""
        keys = [self.K, *self.distortion, self.R, self.t, self.pose, *self.size]
        needed = {key for key in keys if key}
        first = {self.pose} if self.pose_of == "neighbour" else set()
        return all(needed - (set() if k else first) <= of.keys() for k, of in enumerate(records))


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


#: Of records that readers of plain numbers make, in the order of the file.
PLAIN = Layout("", "K", ("distortion",), "R", "t")
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
        return build(layouts[0], records, unit, sizes)


def _name_camera(path: Path, layouts: Sequence[Layout]) -> str:
    match = re.fullmatch(layouts[0].file, path.name, re.IGNORECASE) if layouts else None
    return match[1] if match else path.stem


def build(
    layout: Layout, records: Mapping[str, Record], unit: Unit | None, sizes: Sizes
) -> Calibration:
    """Return the rig of cameras' records by name. Raises InputError naming camera and key."""
    if len(records) > MOST_CAMERAS:
        raise InputError(f"{len(records)} cameras; expected at most {MOST_CAMERAS}")
    measured = {} if layout.size else dict(zip(records, find_sizes([*records], sizes), strict=True))
    cameras, before = [], np.eye(4)
    for name, record in records.items():
        pose = _read_pose(layout, record, f"camera {name}")
        if layout.pose_of == "neighbour":
            pose = before = pose @ before
        size = measured[name] if name in measured else _read_size(layout, record, name)
        cameras.append(_make_camera(layout, name, record, pose, size))
    if layout.program:
        cameras.sort(key=lambda camera: natural_key(camera.name))
    return convert_to_metres(CameraRig(tuple(cameras)), unit, layout.unit)


def _make_camera(layout: Layout, name: str, record: Record, pose: np.ndarray, size: Size) -> Camera:
    K = parse_array(record[layout.K], None, f"camera {name}: {layout.K}")
    if K.size == 4:
        K = np.array([K[0], 0, K[2], 0, K[1], K[3], 0, 0, 1])
    side = 4 if K.size == 16 else 3
    if K.size != side**2:
        raise InputError(f"camera {name}: {layout.K} has {K.size} numbers; expected 4, 9 or 16")
    K = K.reshape(side, side)[:3, :3]
    K = K.T if layout.by_columns else K
    parts = [parse_array(record[key], None, f"camera {name}: {key}") for key in layout.distortion]
    distortion = np.concatenate(parts)
    key, plain, fisheye = layout.lens
    if key and record.get(key) not in (*plain, *fisheye):
        lenses = join_names(str(lens) for lens in (*plain, *fisheye))
        raise InputError(f"camera {name}: the lens is {record.get(key)}; expected {lenses}")
    R = parse_rotation(pose[:3, :3], f"camera {name}: rotation")
    bent = bool(key) and record.get(key) in fisheye
    kappa = float(record.get("kappa", 0.0)) if layout is PLAIN else 0.0
    return Camera(
        name, K, distortion[: 4 if bent else None], R, pose[:3, 3], size, kappa=kappa, fisheye=bent
    )


def _read_pose(layout: Layout, record: Record, what: str) -> np.ndarray:
    """Return the transform (4, 4) from the world, or the neighbour, to the camera."""
    whole = np.eye(4)
    if layout.R:
        R = parse_array(record[layout.R], None, f"{what}: {layout.R}")
        R = parse_rotation(R, f"{what}: {layout.R}") if R.size != 9 else R.reshape(3, 3)
        whole[:3, :3] = R.T if layout.by_columns else R
        whole[:3, 3] = parse_array(record[layout.t], 3, f"{what}: {layout.t}")
    elif layout.pose in record:
        rows = parse_array(record[layout.pose], None, f"{what}: {layout.pose}")
        if rows.size not in (12, 16):
            raise InputError(f"{what}: {layout.pose} has {rows.size} numbers; expected 12 or 16")
        whole[:3] = rows[:12].reshape(3, 4)
    if layout.pose_of == "camera":
        whole[:3, :3] = whole[:3, :3].T
        whole[:3, 3] = -whole[:3, :3] @ whole[:3, 3]
    return whole


def _read_size(layout: Layout, record: Record, name: str) -> Size:
    what = f"camera {name}: {join_names(layout.size)}"
    values = np.concatenate([parse_array(record[key], None, what) for key in layout.size])
    if len(values) != 2:
        raise InputError(f"{what} has {len(values)} numbers; expected width and height")
    return check_whole_size(float(values[0]), float(values[1]), what)


def _find_records(content: Any) -> dict[str, Record]:
    """Return what a file says of each camera: of a list or table of tables, under `cameras` or at
    the top, with poses beside them; of one camera under the empty name."""
    cameras = content.get("cameras", content) if isinstance(content, Mapping) else content
    if isinstance(cameras, Mapping):
        tables = {
            str(k): v for k, v in cameras.items() if isinstance(v, Mapping) and "rows" not in v
        }
        tables.pop("camera_poses", None)
        records = dict(tables) if tables else {"": cameras}
    else:
        tables = {}
        listed = [of for of in cameras if isinstance(of, Mapping)] if cameras else []
        records = {str(of.get("name", f"cam{n:02d}")): of for n, of in enumerate(listed, 1)}
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
            return Storage(path).read_all()
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
