"""Read the cameras of photogrammetry and of renderers.

COLMAP's model is text or, without that, binary. `cameras.txt` has lines CAMERA_ID MODEL WIDTH
HEIGHT PARAMS...; `images.txt` has lines IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME (world to
camera), each followed by a line of points. The binary files are read into the words of these.
COLMAP puts pixel centres at 0.5, so half a pixel is subtracted from the principal point. Every
image is a camera of its own, named after its file, or after its folder if each folder holds one
image.

In the `transforms.json` of Blender and NeRF `transform_matrix` (4x4) takes camera to world
coordinates; the camera's axes are OpenGL's (x right, y up, looking along -z). The lens is
`camera_angle_x`, rad, or `fl_x`, `fl_y`, `cx`, `cy`, `w`, `h`, `k1` ..., given for the file or for
a frame. `camera_model` and instant-ngp's flags say which lens it is: a pinhole lens, with OpenCV's
distortion or none, or OpenCV's fisheye lens.
"""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import IO, Annotated, Any

import numpy as np
from pydantic import Field

from cl import InputError
from psfs.cameras.calibration.common import (
    OPENGL_POSES,
    PLAIN,
    Calibration,
    Sizes,
    build,
    find_sizes,
    name_file_in_errors,
    parse_numbers,
    parse_quaternion,
    read_text,
)
from psfs.cameras.camera import MOST_CAMERAS
from psfs.cameras.names import join_names, natural_key
from psfs.cameras.units import Unit
from psfs.common.files import read_json
from psfs.common.reading import open_input, parsing
from psfs.common.schema import Number, Positive, Table, flat, parse_values

#: Index of fx, fy, cx, cy, k1, k2, p1, p2, k3 among a model's parameters; -1 means zero. Of the
#: fisheye lens k1 to k4.
_MODELS = {
    "SIMPLE_PINHOLE": (0, 0, 1, 2, -1, -1, -1, -1, -1),
    "PINHOLE": (0, 1, 2, 3, -1, -1, -1, -1, -1),
    "SIMPLE_RADIAL": (0, 0, 1, 2, 3, -1, -1, -1, -1),
    "RADIAL": (0, 0, 1, 2, 3, 4, -1, -1, -1),
    "OPENCV": (0, 1, 2, 3, 4, 5, 6, 7, -1),
    "FULL_OPENCV": (0, 1, 2, 3, 4, 5, 6, 7, 8),
    "OPENCV_FISHEYE": (0, 1, 2, 3, 4, 5, 6, 7),
}


def read_colmap(folder: Path, unit: Unit | None) -> Calibration:
    """Read one camera per image, in natural order of their names.

    COLMAP states no unit: metres unless `unit` says otherwise.
    """
    lenses, poses = _read_model(folder)
    with name_file_in_errors(lenses[0]):
        intrinsics = {words[0]: _intrinsics(words) for words in lenses[1]}
    with name_file_in_errors(poses[0]):
        images = poses[1]
        if not images or any(len(words) != 10 for words in images):
            raise InputError("expected lines IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME")
        names = name_cameras([words[9] for words in images])
        records = []
        for name, words in zip(names, images, strict=True):
            if words[8] not in intrinsics:
                raise InputError(f"image {name}: no camera {words[8]}; there are "
                                 f"{join_names(intrinsics)}")  # fmt: skip
            pose = parse_numbers(words[1:8], f"image {name}")
            R = parse_quaternion(pose[[1, 2, 3, 0]], f"image {name}")
            records.append((name, {**intrinsics[words[8]], "R": R, "t": pose[4:]}))
        return build(replace(PLAIN, program="COLMAP"), records, unit, None)


def _read_model(folder: Path) -> tuple[tuple[Path, list[list[str]]], tuple[Path, list[list[str]]]]:
    """Return the files of cameras and of images, and their entries in words."""
    paths = [folder / f"{name}.txt" for name in ("cameras", "images")]
    if not paths[0].is_file() and (folder / "cameras.bin").is_file():
        binary = [path.with_suffix(".bin") for path in paths]
        cameras, images = read_binary_cameras(binary[0]), read_binary_images(binary[1])
        return (binary[0], cameras), (binary[1], images)
    cameras = [line.split() for line in _lines(paths[0]) if line.strip()]
    images = [line.split(maxsplit=9) for line in _lines(paths[1])[::2]]
    return (paths[0], cameras), (paths[1], [words for words in images if words])


def name_cameras(paths: list[str]) -> list[str]:
    """Name each image's camera after its folder if the folders or the files' names differ, else
    after its file."""
    folders = [PurePosixPath(path).parent.name for path in paths]
    files = {PurePosixPath(path).stem for path in paths}
    if all(folders) and len(paths) > 1 and len(set(folders)) >= max(2, len(files)):
        return folders
    return [PurePosixPath(path).stem for path in paths]


def _lines(path: Path) -> list[str]:
    return [line for line in read_text(path).splitlines() if not line.startswith("#")]


def _intrinsics(words: list[str]) -> dict[str, Any]:
    if len(words) < 4 or words[1] not in _MODELS:
        model = words[1] if len(words) > 1 else "nothing"
        raise InputError(f"camera model {model}; expected one of {join_names(_MODELS)}")
    values = parse_numbers(words[2:], f"camera {words[0]}")
    places, parameters = _MODELS[words[1]], values[2:]
    if parameters.size <= max(places):
        raise InputError(f"camera {words[0]}: {parameters.size} parameters for {words[1]}")
    if parameters[max(places) + 1 :].any():
        raise InputError(f"camera {words[0]}: rational distortion; expected k1 k2 p1 p2 k3 alone")
    fx, fy, cx, cy, *distortion = (parameters[place] if place >= 0 else 0.0 for place in places)
    K = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
    fisheye = words[1] == "OPENCV_FISHEYE"
    return {"K": K, "distortion": distortion, "size": values[:2], "fisheye": fisheye}


#: Names and numbers of parameters of the models, by their ids.
_BINARY_MODELS = {
    0: ("SIMPLE_PINHOLE", 3), 1: ("PINHOLE", 4), 2: ("SIMPLE_RADIAL", 4), 3: ("RADIAL", 5),
    4: ("OPENCV", 8), 5: ("OPENCV_FISHEYE", 8), 6: ("FULL_OPENCV", 12), 7: ("FOV", 5),
    8: ("SIMPLE_RADIAL_FISHEYE", 4), 9: ("RADIAL_FISHEYE", 5), 10: ("THIN_PRISM_FISHEYE", 12),
}  # fmt: skip
_WHAT = "COLMAP's binary model"


def read_binary_cameras(path: Path) -> list[list[str]]:
    """Return ID, model, width, height and parameters of each camera. Raises InputError."""
    with open_input(path, _WHAT) as file, parsing(path, _WHAT):
        cameras = []
        for _ in range(_read_count(file, path)):
            number, model, width, height = _unpack(file, "<iiQQ", path)
            if model not in _BINARY_MODELS:
                raise InputError(f"{path}: camera {number} has model {model}; expected 0 to 10")
            name, count = _BINARY_MODELS[model]
            values = _unpack(file, f"<{count}d", path)
            cameras.append([str(number), name, str(width), str(height), *map(repr, values)])
        return cameras


def read_binary_images(path: Path) -> list[list[str]]:
    """Return ID, quaternion, translation, camera ID and name of each image. Raises InputError."""
    with open_input(path, _WHAT) as file, parsing(path, _WHAT):
        images = []
        for _ in range(_read_count(file, path)):
            number, *pose, camera = _unpack(file, "<i7di", path)
            name = bytearray()
            while (letter := file.read(1)) not in (b"\0", b""):
                name += letter
            (points,) = _unpack(file, "<Q", path)
            if file.tell() + 24 * points > path.stat().st_size:
                raise InputError(f"{path}: image {number} is damaged; expected {_WHAT}")
            file.seek(24 * points, 1)
            images.append([str(number), *map(repr, pose), str(camera), name.decode("utf-8")])
        return images


def _read_count(file: IO[bytes], path: Path) -> int:
    (count,) = _unpack(file, "<Q", path)
    if count > MOST_CAMERAS:
        raise InputError(f"{path}: {count} entries; expected at most {MOST_CAMERAS} in {_WHAT}")
    return int(count)


def _unpack(file: IO[bytes], layout: str, path: Path) -> tuple[Any, ...]:
    size = struct.calcsize(layout)
    content = file.read(size)
    if len(content) < size:
        raise InputError(f"{path}: ends in the middle of an entry; expected {_WHAT}")
    return struct.unpack(layout, content)


#: Values of `camera_model` for OpenCV's pinhole camera and its special cases.
_PINHOLE = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "RADIAL", "SIMPLE_RADIAL", "PERSPECTIVE")
_FISHEYE = "OPENCV_FISHEYE"
#: Keys of other lenses that instant-ngp reads.
_OTHER_LENSES = ("ftheta_p0", "latlong", "equirectangular", "orthographic")


class View(Table):
    """A picture with its pose and its lens, whose keys may stand for the whole file."""

    file_path: str
    transform_matrix: Annotated[list[float], flat(12, 16)]
    camera_angle_x: Annotated[float, Field(gt=0, lt=math.pi)] | None = None
    camera_angle_y: Annotated[float, Field(gt=0, lt=math.pi)] | None = None
    fl_x: Positive | None = None
    fl_y: Positive | None = None
    cx: Number | None = None
    cy: Number | None = None
    w: Positive | None = None
    h: Positive | None = None
    k1: Number = 0.0
    k2: Number = 0.0
    k3: Number = 0.0
    k4: Number = 0.0
    p1: Number = 0.0
    p2: Number = 0.0
    camera_model: str = ""
    is_fisheye: Number | bool = False
    ftheta_p0: Number = 0.0
    latlong: Number | bool = False
    equirectangular: Number | bool = False
    orthographic: Number | bool = False


class Transforms(Table):
    """The whole file; further keys are the lens of all frames."""

    frames: Annotated[list[dict[str, Any]], Field(min_length=1, max_length=MOST_CAMERAS)]


def read_transforms(path: Path, unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read the cameras in natural order of their pictures' names.

    Metres unless `unit` says otherwise. `sizes` are used where the file has none.
    """
    content = read_json(path, "NeRF's transforms.json")
    frames = parse_values(Transforms, content, path).frames
    views = []
    for number, frame in enumerate(frames):
        tables = content, frame
        stated = {key: v for table in tables for key, v in table.items() if v is not None}
        views.append(parse_values(View, stated, f"{path}: frames.{number}"))
    with name_file_in_errors(path):
        named = list(zip(name_cameras([view.file_path for view in views]), views, strict=True))
        named.sort(key=lambda entry: natural_key(entry[0]))
        found = [(view.w, view.h) for _, view in named if view.w and view.h]
        if len(found) < len(named):
            found = [*find_sizes([name for name, _ in named], sizes)]
        pairs = zip(named, found, strict=True)
        records = [(name, _make_record(name, view, size)) for (name, view), size in pairs]
        return build(OPENGL_POSES, records, unit, None)


def _is_fisheye(name: str, view: View) -> bool:
    """Return whether the lens is OpenCV's fisheye lens. Raises InputError for any but that and a
    pinhole lens with OpenCV's distortion."""
    model = view.camera_model.upper()
    fisheye = model == _FISHEYE or bool(not model and view.is_fisheye)
    other = [key for key in _OTHER_LENSES if getattr(view, key)]
    other += ["k4"] if not fisheye and view.k4 else []
    if model and model not in (*_PINHOLE, _FISHEYE):
        other.insert(0, f"camera_model {model}")
    if other:
        raise InputError(
            f"camera {name}: {join_names(other)}; expected a pinhole or fisheye camera, "
            f"{join_names((*_PINHOLE, _FISHEYE))}: undistort the pictures to one first"
        )
    return fisheye


def _make_record(name: str, view: View, size: tuple[float, float]) -> dict[str, Any]:
    fisheye, (width, height) = _is_fisheye(name, view), size
    angle, angle_y = view.camera_angle_x, view.camera_angle_y
    fx = view.fl_x or (0.5 * width / math.tan(angle / 2) if angle else None)
    if fx is None:
        raise InputError(f"camera {name}: neither fl_x nor camera_angle_x; expected one of them")
    fy = view.fl_y or (0.5 * height / math.tan(angle_y / 2) if angle_y else fx)
    # The middle of the picture is at w / 2 there, and at (w - 1) / 2 here.
    cx, cy = (
        (side / 2 if centre is None else centre) - 0.5
        for side, centre in ((width, view.cx), (height, view.cy))
    )
    keys = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
    return {
        "K": [fx, fy, cx, cy],
        "distortion": [getattr(view, key) for key in keys],
        "pose": view.transform_matrix,
        "size": size,
        "fisheye": fisheye,
    }
