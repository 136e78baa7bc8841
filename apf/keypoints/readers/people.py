"""Read keypoints of several persons per frame: OpenPose's JSON, and OpenCap's pickles.

OpenPose writes a file per camera and frame, `{"people": [{"pose_keypoints_2d": [x, y, c, ...]}]}`;
so do Pose2Sim (`pose/cam01_json/cam01_000000.json`), Sports2D and AlphaPose with `--format open`.
By default AlphaPose writes one list of persons a video, with the picture's name in each;
`--format cmu` and `open` an object of pictures. OpenCap stores the
same lists in a pickle per camera and trial
(`Videos/Cam0/OutputPkl_default/jump/jump_rotated_pp.pkl`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from apf.keypoints.readers.orders import find_order
from apf.keypoints.readers.plain_pickle import read_plain_pickle
from apf.keypoints.readers.raw import RawKeypoints
from cl import InputError
from psfs.cameras.names import join_names
from psfs.common.files import read_json
from psfs.common.reading import parsing

#: `cam01.0000`, `cam01_000000_keypoints`: the camera, and the frame.
_STEM = re.compile(r"(?P<camera>.*?)[._-]?(?P<frame>\d+)(?:[._-]keypoints)?")
#: OpenCap's pickles: of its own pipeline, and of its downloads.
OPENCAP = ("*_rotated_pp.pkl", "*_keypoints.pkl")
_POINTS = "pose_keypoints_2d"
#: Most frames without a file, as a multiple of those with one.
_MOST_GAPS = 20
#: Most persons of a picture, numbers of a person, and bytes of all keypoints of a camera. Holistic
#: networks list 553 points.
_MOST_PERSONS, _MOST_NUMBERS, _MOST_BYTES = 200, 3000, 2**30
#: Most persons in all frames of a camera together; an hour of ten persons has so many.
_MOST_OF_ALL_FRAMES = 2_000_000
#: Largest JSON file, which is of one picture.
_MOST_JSON_BYTES = 16 * 2**20
#: Largest JSON file of a video.
_MOST_LIST_BYTES = 2**29
_PICKLED = "a pickle of plain lists of frames, persons and pose_keypoints_2d"


def read_openpose(folder: Path, paths: Sequence[Path]) -> RawKeypoints | None:
    """Read OpenPose's JSON files, `paths` in `folder` or below; None if none of them is.

    Files with the same folder and the same beginning belong to one camera; the number at the end is
    the frame's. Frames without a file are missing. Raises InputError naming the file that is wrong.
    """
    cameras: dict[tuple[str, ...], dict[int, Path]] = {}
    for path in paths:
        found = _STEM.fullmatch(path.stem)
        if found is None:
            continue
        parts = (*path.relative_to(folder).parent.parts, found["camera"])
        files = cameras.setdefault(parts, {})
        if int(found["frame"]) in files:
            other = files[int(found["frame"])].name
            raise InputError(f"{path}: has the frame number of {other}; expected one file a frame")
        files[int(found["frame"])] = path
    views = {
        parts: {frame: _parse_persons(path, _read_picture(path)) for frame, path in files.items()}
        for parts, files in cameras.items()
        if _is_openpose(next(iter(files.values())))
    }
    if not views:
        return None
    first = min(min(frames) for frames in views.values())  # 0, 1 or, of a cut video, any number
    people = {parts: _order_frames(folder, frames, first) for parts, frames in views.items()}
    return _build_raw(folder, people)


def read_alphapose(folder: Path, paths: Sequence[Path]) -> RawKeypoints | None:
    """Read AlphaPose's results, one file per video; None if none of `paths` is.

    Pictures without a person are missing in it; the number at the end of a picture's name is the
    frame's. Raises InputError naming the file that is wrong.
    """
    views, counted = {}, True
    for path in paths:
        content = read_json(path, "JSON of a video", _MOST_LIST_BYTES, nan=True)
        persons = _list_alphapose(content)
        if persons is not None:
            frames: dict[int, list[np.ndarray]] = {}
            for number, (picture, points) in enumerate(persons):
                found = _STEM.fullmatch(Path(picture).stem)
                if found is None:
                    raise InputError(f"{path}: image_id {picture!r}; expected a frame's number")
                counted = counted and Path(picture).stem == str(int(found["frame"]))
                own = frames.setdefault(int(found["frame"]), [])
                own.append(_parse_points(path, number, {_POINTS: points}))
            if frames:
                parts = (*path.relative_to(folder).parent.parts, path.stem)
                views[parts] = frames
    if not views:
        return None
    # Of a video it counts the pictures itself, from 0 on: 0.jpg, 1.jpg, ...
    first = 0 if counted else min(map(min, views.values()))
    people = {parts: _order_frames(folder, frames, first) for parts, frames in views.items()}
    return _build_raw(folder, people)


def _list_alphapose(content: object) -> list[tuple[str, object]] | None:
    """Return the pictures' names and the persons' numbers; None if the content is another."""
    if isinstance(content, list):
        entries = [
            of for of in content if isinstance(of, dict) and {"image_id", "keypoints"} <= set(of)
        ]
        whole = len(entries) == len(content) > 0
        return [(str(of["image_id"]), of["keypoints"]) for of in entries] if whole else None
    found: list[tuple[str, object]] = []
    for picture, value in content.items() if isinstance(content, dict) else ():
        persons = value.get("bodies", value.get("people")) if isinstance(value, dict) else None
        if not isinstance(persons, list) or not all(isinstance(of, dict) for of in persons):
            return None
        found += [(picture, of.get("joints", of.get(_POINTS))) for of in persons]
    return found or None


def read_opencap(folder: Path, paths: Sequence[Path]) -> RawKeypoints:
    """Read OpenCap's pickles (frames, persons) with OpenPose's lists.

    Only lists, numbers and texts are unpickled. Raises InputError naming the file that is wrong.
    """
    people = {}
    for path in paths:
        frames = read_plain_pickle(path, _PICKLED)
        if not isinstance(frames, list):
            raise InputError(f"{path}: holds a {type(frames).__name__}; expected {_PICKLED}")
        if sum(len(frame) for frame in frames if isinstance(frame, list)) > _MOST_OF_ALL_FRAMES:
            raise InputError(f"{path}: more than {_MOST_OF_ALL_FRAMES:,} persons in all frames")
        parts = (*path.relative_to(folder).parent.parts, path.stem)
        people[parts] = [_parse_persons(path, {"people": frame}) for frame in frames]
    return _build_raw(folder, people)


def _is_openpose(path: Path) -> bool:
    """Return whether this is a file of keypoints and not some other JSON."""
    content = _read_picture(path)
    return isinstance(content, dict) and "people" in content


def _read_picture(path: Path) -> object:
    return read_json(path, "OpenPose's JSON of a picture", _MOST_JSON_BYTES, nan=True)


def _parse_persons(path: Path, content: object) -> list[np.ndarray]:
    """Parse the persons (K, 3) of a frame. Raises InputError."""
    persons = content.get("people") if isinstance(content, dict) else None
    if not isinstance(persons, list):
        raise InputError(f"{path}: lacks the list people; expected OpenPose's JSON")
    if len(persons) > _MOST_PERSONS:
        raise InputError(
            f"{path}: {len(persons):,} persons in a picture; expected at most {_MOST_PERSONS}"
        )
    points = (_parse_points(path, number, person) for number, person in enumerate(persons))
    # OpenPose leaves the list empty if it only searched for hands
    return [found for found in points if len(found)]


def _parse_points(path: Path, number: int, person: object) -> np.ndarray:
    """Parse the points (K, 3) of a person. Raises InputError."""
    values = person.get(_POINTS) if isinstance(person, dict) else None
    if (
        isinstance(values, list)
        and len(values) <= _MOST_NUMBERS
        and len(values) % 3 == 0
        and all(type(value) in (int, float) for value in values)
    ):
        with parsing(path, "pixels and confidences"):
            return np.array(values, np.float64).reshape(-1, 3)
    count = f"{len(values):,}" if isinstance(values, list) else type(values).__name__
    raise InputError(
        f"{path}: {_POINTS} of person {number} is not a list x, y, confidence, x, ... of at most "
        f"{_MOST_NUMBERS} numbers; found {count} values"
    )


def _order_frames(
    folder: Path, frames: dict[int, list[np.ndarray]], first: int
) -> list[list[np.ndarray]]:
    """List the persons of every frame from number `first` on; none for frames without a file."""
    n_frames = max(frames) - first + 1
    if n_frames > _MOST_GAPS * len(frames):
        raise InputError(
            f"{folder}: {len(frames)} files of a camera have frame numbers {min(frames)} to "
            f"{max(frames)}; expected numbers that follow each other"
        )
    return [frames.get(first + number, []) for number in range(n_frames)]


def _build_raw(path: Path, people: dict[tuple[str, ...], list[list[np.ndarray]]]) -> RawKeypoints:
    """Stack persons (K, 3) of all frames of all cameras."""
    counts = sorted({len(p) for frames in people.values() for frame in frames for p in frame})
    if not counts:
        raise InputError(f"{path}: no person was found in any frame of any camera")
    if len(counts) > 1:
        found = join_names(map(str, counts))
        raise InputError(f"{path}: persons have {found} keypoints; expected the same number of all")
    views = {}
    for name, frames in zip(_short_names(list(people)), people.values(), strict=True):
        shape = (len(frames), max([1, *map(len, frames)]), counts[0], 3)
        if 8 * math.prod(shape) > _MOST_BYTES:
            raise InputError(
                f"{path}: camera {name}: {shape[0]:,} frames of up to {shape[1]} persons with "
                f"{shape[2]} points; expected at most {_MOST_BYTES // 2**30} GiB of a camera"
            )
        view = np.full(shape, np.nan)
        for row, frame in zip(view, frames, strict=True):
            row[: len(frame)] = np.array(frame).reshape(-1, counts[0], 3)
        view[(view[..., 2] == 0) | np.isnan(view).any(-1)] = np.nan  # not found
        views[name] = view
    points = np.concatenate([view.reshape(-1, counts[0], 3) for view in views.values()])
    names = find_order(str(path), points)
    return RawKeypoints(path, names, {name: v[:, :, : len(names)] for name, v in views.items()})


def _short_names(paths: list[tuple[str, ...]]) -> list[str]:
    """Shorten these paths to names, without the parts that all share at the beginning or end."""
    parts = [list(path) for path in paths]
    for end in (0, -1):
        while min(map(len, parts)) > 1 and len({path[end] for path in parts}) == 1:
            for path in parts:
                del path[end]
    return ["/".join(part for part in path if part) or "." for path in parts]
