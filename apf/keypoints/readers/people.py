"""Read keypoints of several persons per frame, as many programs list them.

A file per camera and frame: OpenPose's `{"people": [{"pose_keypoints_2d": [x, y, c, ...]}]}`, which
Pose2Sim (`pose/cam01_json/cam01_000000.json`), Sports2D and AlphaPose with `--format open` write,
too; EasyMocap's, MMPose's, and YOLO's labels. `LAYOUTS` says where each lists what. A file per
video: AlphaPose's (a list, or with `--format cmu` and `open` an object of pictures) and MMPose's.
OpenCap stores OpenPose's lists in a pickle per camera and trial
(`Videos/Cam0/OutputPkl_default/jump/jump_rotated_pp.pkl`).
"""

from __future__ import annotations

import io
import math
import pickle
import pickletools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

import numpy as np

from apf.keypoints.readers.orders import COCO_17, find_order
from apf.keypoints.readers.raw import RawKeypoints
from cl import InputError
from psfs.cameras.names import join_names
from psfs.common.files import MOST_BYTES, read_json, read_text
from psfs.common.ranges import MOST_FRAMES
from psfs.common.reading import open_input, parsing


class _Plain(pickle.Unpickler):
    """Python's reader of what `_check_sizes` let pass, without code."""

    def find_class(self, module: str, name: str) -> NoReturn:
        raise InputError(f"names code ({module} {name})"[:90] + ", which is never run")


def _check_sizes(data: bytes) -> None:
    """Raise ValueError where a pickle states more than it holds: the reader allocates values of
    stated lengths before it reads them, and a table of as many values as the largest number."""
    for operation, argument, _ in pickletools.genops(data):  # checks the lengths itself
        if operation.name in ("PUT", "BINPUT", "LONG_BINPUT") and int(argument or 0) > len(data):
            raise ValueError(f"value {argument:,} of a file of {len(data):,} bytes")


def read_plain_pickle(path: Path, what: str) -> object:
    """Read a pickle of plain values.

    what: description of the expected content, for errors. Raises InputError for a file that is
    damaged, too large, or names anything that is no plain value.
    """
    with parsing(path, what), open_input(path, what) as file:
        data = file.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise InputError(f"{path}: more than {MOST_BYTES // 2**20} MiB; expected {what}")
        try:
            _check_sizes(data)
            return _Plain(io.BytesIO(data)).load()
        except InputError as error:
            raise InputError(f"{path}: {error}; expected {what}") from None


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
_PICKLED = "a pickle of plain lists of frames, persons and pose_keypoints_2d"


@dataclass(frozen=True)
class PersonLayout:
    """Where a program's JSON of a picture has its persons: under the key `persons`, or it is a list
    of them; each with numbers under `points`: x, y and, unless `scores` has these, confidence."""

    persons: str
    points: str
    scores: str = ""

    def list_persons(self, content: object) -> list[object] | None:
        """Return the persons of a picture; None if the content has another layout."""
        persons = content
        if self.persons:
            persons = content.get(self.persons) if isinstance(content, Mapping) else None
        if not isinstance(persons, list):
            return None
        keys = {self.points, self.scores} - {""}
        known = all(isinstance(person, Mapping) and keys <= person.keys() for person in persons)
        return persons if self.persons or (persons and known) else None


OPENPOSE = PersonLayout("people", _POINTS)
EASYMOCAP = PersonLayout("annots", "keypoints")
MMPOSE = PersonLayout("", "keypoints", "keypoint_scores")
LAYOUTS = (OPENPOSE, EASYMOCAP, MMPOSE)
#: Numbers of a line of YOLO's labels before the keypoints: class, and the box's middle and size.
_YOLO_HEAD = 5


def read_pictures(folder: Path, paths: Sequence[Path]) -> RawKeypoints | None:
    """Read a file per camera and frame, `paths` in `folder` or below; None if none of them is one.

    Files with the same folder and the same beginning belong to one camera; the number at the end is
    the frame's. Frames without a file are missing. Raises InputError naming the file that is wrong.
    """
    cameras: dict[tuple[str, ...], dict[int, Path]] = {}
    for path in paths:
        match = _STEM.fullmatch(path.stem)
        if match is None:
            continue
        parts = (*path.relative_to(folder).parent.parts, match["camera"])
        files = cameras.setdefault(parts, {})
        if int(match["frame"]) in files:
            other = files[int(match["frame"])].name
            raise InputError(f"{path}: has the frame number of {other}; expected one file a frame")
        files[int(match["frame"])] = path
    views = {}
    for parts, files in cameras.items():
        read = _find_reader([*files.values()])
        if read is not None:
            views[parts] = {n: read(path) for n, path in files.items()}
    if not views:
        return None
    first = min(min(frames) for frames in views.values())  # 0, 1 or, of a cut video, any number
    people = {parts: _order_frames(folder, frames, first) for parts, frames in views.items()}
    labels = next(iter(next(iter(cameras.values())).values())).suffix == _LABELS
    return replace(_build_raw(folder, people), shares=labels, first=first)


_LABELS = ".txt"


def _find_reader(paths: Sequence[Path]) -> Callable[[Path], list[np.ndarray]] | None:
    """Return what reads a camera's files, by the first with somebody; None if none fits."""
    if paths[0].suffix == _LABELS:
        return _parse_labels if _parse_labels(paths[0]) else None
    fits = []
    for path in paths:
        content = _read_picture(path)
        fits = [layout for layout in LAYOUTS if layout.list_persons(content) is not None]
        if fits or content != []:  # MMPose's list of nobody
            break
    return (lambda path: _parse_persons(path, _read_picture(path), fits[0])) if fits else None


def _parse_labels(path: Path) -> list[np.ndarray]:
    """Return the persons (K, 3) of a file of YOLO's labels, shares of the picture: lines of class,
    box, x, y and perhaps confidence of 17 points, and perhaps the person's; none of other texts."""
    persons = []
    for line in read_text(path, "YOLO's labels").splitlines():
        try:
            values = np.array([float(word) for word in line.split()])
        except ValueError:
            return []
        n = len(COCO_17)
        for width in (3, 2):
            if len(values) in (_YOLO_HEAD + width * n, _YOLO_HEAD + width * n + 1):
                points = values[_YOLO_HEAD : _YOLO_HEAD + width * n].reshape(n, width)
                persons.append(np.column_stack([points, np.ones((n, 3 - width))]))
                break
        else:
            return []
    return persons


def read_mmpose(folder: Path, paths: Sequence[Path]) -> RawKeypoints | None:
    """Read MMPose's results of videos, a file each; None if none of `paths` is. Raises InputError
    naming the file that is wrong."""
    people: dict[tuple[str, ...], list[list[np.ndarray]]] = {}
    for path in paths:
        content = read_json(path, "JSON of a video", nan=True)
        frames = content.get("instance_info") if isinstance(content, Mapping) else None
        if isinstance(frames, list) and all(isinstance(frame, Mapping) for frame in frames):
            parts = (*path.relative_to(folder).parent.parts, path.stem)
            instances = PersonLayout("instances", MMPOSE.points, MMPOSE.scores)
            people[parts] = [_parse_persons(path, frame, instances) for frame in frames]
    return _build_raw(folder, people) if people else None


def read_alphapose(folder: Path, paths: Sequence[Path]) -> RawKeypoints | None:
    """Read AlphaPose's results, one file per video; None if none of `paths` is.

    Pictures without a person are missing in it; the number at the end of a picture's name is the
    frame's. Raises InputError naming the file that is wrong.
    """
    views, counted = {}, True
    for path in paths:
        content = read_json(path, "JSON of a video", nan=True)
        persons = _list_alphapose(content)
        if persons is not None:
            frames: dict[int, list[np.ndarray]] = {}
            for number, (picture, points) in enumerate(persons):
                match = _STEM.fullmatch(Path(picture).stem)
                if match is None:
                    raise InputError(f"{path}: image_id {picture!r}; expected a frame's number")
                counted = counted and Path(picture).stem == str(int(match["frame"]))
                pictured = frames.setdefault(int(match["frame"]), [])
                pictured.append(_parse_points(path, number, {_POINTS: points}))
            if frames:
                parts = (*path.relative_to(folder).parent.parts, path.stem)
                views[parts] = frames
    if not views:
        return None
    # Of a video it counts the pictures itself, from 0 on: 0.jpg, 1.jpg, ...
    first = 0 if counted else min(map(min, views.values()))
    people = {parts: _order_frames(folder, frames, first) for parts, frames in views.items()}
    return replace(_build_raw(folder, people), first=first, sparse=counted)


def _list_alphapose(content: object) -> list[tuple[str, object]] | None:
    """Return the pictures' names and the persons' numbers; None if the content is another."""
    if isinstance(content, list):
        entries = [
            e for e in content if isinstance(e, dict) and {"image_id", "keypoints"} <= set(e)
        ]
        whole = len(entries) == len(content) > 0
        return [(str(row["image_id"]), row["keypoints"]) for row in entries] if whole else None
    listed: list[tuple[str, object]] = []
    for picture, value in content.items() if isinstance(content, dict) else ():
        persons = value.get("bodies", value.get("people")) if isinstance(value, dict) else None
        if not isinstance(persons, list) or not all(isinstance(entry, dict) for entry in persons):
            return None
        listed += [(picture, entry.get("joints", entry.get(_POINTS))) for entry in persons]
    return listed or None


def read_opencap(folder: Path, paths: Sequence[Path]) -> RawKeypoints:
    """Read OpenCap's pickles (frames, persons) with OpenPose's lists.

    Only lists, numbers and texts are unpickled. Raises InputError naming the file that is wrong.
    """
    people: dict[tuple[str, ...], list[list[np.ndarray]]] = {}
    for path in paths:
        frames = read_plain_pickle(path, _PICKLED)
        if not isinstance(frames, list):
            raise InputError(f"{path}: holds a {type(frames).__name__}; expected {_PICKLED}")
        if sum(len(frame) for frame in frames if isinstance(frame, list)) > MOST_FRAMES:
            raise InputError(f"{path}: more than {MOST_FRAMES:,} persons in all frames")
        parts = (*path.relative_to(folder).parent.parts, path.stem)
        people[parts] = [_parse_persons(path, {"people": frame}) for frame in frames]
    return _build_raw(folder, people)


def _read_picture(path: Path) -> object:
    return read_json(path, "OpenPose's JSON of a picture", nan=True)


def _parse_persons(
    path: Path, content: object, layout: PersonLayout = OPENPOSE
) -> list[np.ndarray]:
    """Parse the persons (K, 3) of a frame. Raises InputError."""
    persons = [] if content == [] else layout.list_persons(content)
    if persons is None:
        raise InputError(f"{path}: lacks the list {layout.persons}; expected that of the others")
    if len(persons) > _MOST_PERSONS:
        raise InputError(
            f"{path}: {len(persons):,} persons in a picture; expected at most {_MOST_PERSONS}"
        )
    points = (_parse_points(path, n, person, layout) for n, person in enumerate(persons))
    # OpenPose leaves the list empty if it only searched for hands
    return [known for known in points if len(known)]


def _parse_points(
    path: Path, number: int, person: object, layout: PersonLayout = OPENPOSE
) -> np.ndarray:
    """Parse the points (K, 3) of a person. Raises InputError."""
    values = person.get(layout.points) if isinstance(person, Mapping) else None
    if isinstance(values, list) and values and all(isinstance(row, list) for row in values):
        scores = person.get(layout.scores) if isinstance(person, Mapping) else None
        if isinstance(scores, list) and len(scores) == len(values):
            values = [[*row[:2], score] for row, score in zip(values, scores, strict=True)]
        values = [value for row in values for value in row]
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
        f"{path}: {layout.points} of person {number} is not a list x, y, confidence, x, ... of at "
        f"most {_MOST_NUMBERS} numbers; found {count} values"
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
        sizes = join_names(map(str, counts))
        raise InputError(f"{path}: persons have {sizes} keypoints; expected the same number of all")
    views, parts = {}, [list(path_parts) for path_parts in people]
    for end in (0, -1):  # without the parts that all share at the beginning or end
        while min(map(len, parts)) > 1 and len({path_parts[end] for path_parts in parts}) == 1:
            for path_parts in parts:
                del path_parts[end]
    short = ["/".join(name for name in path_parts if name) or "." for path_parts in parts]
    for name, frames in zip(short, people.values(), strict=True):
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
