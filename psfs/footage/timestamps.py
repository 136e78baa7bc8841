"""The times of frames in `timestamps.csv`, which a recorder that drops frames writes.

A row per frame of a camera: `cam_id` (or `camera`), `frame_index` (or `frame`), `frame_time` (or
`time`), s, as Caliscope and FreeMoCap write. The k-th frame of a camera's rows, ordered by number,
is the k-th of its video.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cl import InputError
from psfs.cameras.names import join_names, name_tokens
from psfs.common.files import MOST_BYTES, read_text
from psfs.common.reading import parsing
from psfs.footage.layouts.common import Footage
from psfs.footage.media import Media

NAME = "timestamps.csv"
_WHAT = "times of frames"
#: Least ratio of times in another unit than s.
_OTHER_UNIT = 100
#: Names of the columns, the first that is there.
_COLUMNS = (("cam_id", "camera"), ("frame_index", "frame"), ("frame_time", "time"))


def read_timestamps(footage: Footage) -> list[np.ndarray] | None:
    """Return the times (F,) s of the frames of each camera's video, None without the file.

    It lies beside the videos. Raises InputError for a file that does not fit the videos.
    """
    media = footage.images
    if not media or not all(item.is_video for item in media):
        return None
    path = media[0].paths[0].parent / NAME
    if not path.is_file():
        return None
    _assign_times(path, footage.masks or ())  # raises for masks of other frames than the videos'
    return _assign_times(path, media)


def _assign_times(path: Path, media: Sequence[Media]) -> list[np.ndarray]:
    """Return the times (F,) s of the frames of each camera's video."""
    by_camera = _read_times(path)
    found = []
    for item in media:
        tokens = name_tokens(item.name)
        named = [c for c in by_camera if name_tokens(c) in (tokens, tokens[-1:])]
        if len(named) != 1:
            raise InputError(
                f"{path}: {len(named)} cameras match {item.name}; found {join_names(by_camera)}"
            )
        rows = sorted(by_camera[named[0]])
        times = np.array([time for _, time in rows])
        if len(times) != item.count or (np.diff(times) <= 0).any():
            raise InputError(
                f"{path}: {len(times)} times of {item.name}, whose video has {item.count} frames; "
                "expected one for each frame, ascending"
            )
        _check_interval(path, item, times)
        found.append(times)
    return found


def _check_interval(path: Path, item: Media, times: np.ndarray) -> None:
    """Raise InputError if times are of another unit: ms or ns, with which other programs count."""
    if len(times) < 2 or item.fps is None:
        return
    interval = float(np.median(np.diff(times)))
    if not 1 / _OTHER_UNIT < interval * item.fps < _OTHER_UNIT:
        raise InputError(
            f"{path}: {interval:.3g} between the frames of {item.name}, whose video has "
            f"{item.fps:g} per second; expected times in s"
        )


def _read_times(path: Path) -> dict[str, list[tuple[int, float]]]:
    """Return frame numbers and times, s, by camera."""
    text = read_text(path, _WHAT, MOST_BYTES)
    with parsing(path, _WHAT):
        reader = csv.DictReader(io.StringIO(text, newline=""))
        heads, rows = reader.fieldnames or (), list(reader)
    names = [next((name for name in options if name in heads), None) for options in _COLUMNS]
    if None in names:
        wanted = ", ".join(" or ".join(options) for options in _COLUMNS)
        raise InputError(f"{path}: columns {join_names(heads)}; expected {wanted}")
    camera, frame, time = names
    found: dict[str, list[tuple[int, float]]] = {}
    for line, row in enumerate(rows, 2):
        try:
            value = int(row[frame]), float(row[time])
        except (TypeError, ValueError):
            raise InputError(f"{path}: line {line}; expected a frame's number and time") from None
        if not np.isfinite(value[1]):
            raise InputError(f"{path}: line {line}: time {value[1]}; expected seconds")
        found.setdefault(str(row[camera]), []).append(value)
    return found
