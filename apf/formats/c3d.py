"""Read and write C3D files, the exchange format of motion laboratories (Vicon, Qualisys, Visual3D).

Read: metres, centimetres or millimetres; the up axis is the one that the caller or POINT:Y_SCREEN
states, else Z. Written: millimetres, Z up as in the tracker's world; POINT:X_SCREEN and Y_SCREEN
state it. A point's residual is its possible error, 0 if unknown; a missing point has the residual
-1, as the format requires.
"""

from __future__ import annotations

import itertools
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from apf.formats.trc import CONVENTIONS, JointSeries
from cl import InputError
from psfs.common.c3d import read_c3d_points
from psfs.common.files import temporary_folder, write_atomically

#: The header counts frames in 16 bits, in which py-c3d adds 1 to the last one. A parameter has at
#: most so many texts; ezc3d writes a file of more labels or events that it cannot read.
_MOST_FRAMES, _MOST_TEXTS = 65534, 255


@dataclass(frozen=True)
class C3dEvent:
    """An event of gait.

    label: as laboratories write it, Foot Strike or Foot Off. context: Left or Right. time: since
    the sequence's first frame, s.
    """

    label: str
    context: str
    time: float


def read_c3d(path: str | Path, convention: str | None = None) -> JointSeries:
    """Read the points of a C3D into the world, Z up, missing ones NaN.

    Rate and frame numbers are the file's, from 0 on. convention: of its axes, one of `CONVENTIONS`;
    by default what the file states. Raises InputError naming the file.
    """
    path = Path(path)
    recording = read_c3d_points(path)
    if convention is None:
        stated = "+Z" if recording.up is None else recording.up.strip().upper()
        convention = {"+Z": "z-up", "Z": "z-up", "+Y": "y-up", "Y": "y-up"}.get(stated)
        if convention is None:
            raise InputError(
                f"{path}: POINT:Y_SCREEN is {stated!r}; expected +Z or +Y, or --convention"
            )
    matrix = CONVENTIONS[convention]
    frames = recording.first + np.arange(len(recording.positions))
    return JointSeries(recording.names, recording.positions @ matrix.T, recording.rate, frames)


def write_c3d(
    path: str | Path, series: JointSeries, events: Sequence[C3dEvent] = ()
) -> tuple[Path, ...]:
    """Write points and events; return the files.

    A file has at most 65534 frames and 255 points. Those that follow go into files beside `path`,
    `<name>_frame65534`, `<name>_point255`, named by the frame of the sequence that they call 0 and
    by their first point. A file has its first 255 events. Raises InputError for no frame and if a
    file cannot be written.
    """
    path, names = Path(path), series.joint_names
    if not len(series.frames):
        raise InputError(f"{path}: a C3D of no frame cannot be written; expected at least one")
    series.to_constant_rate()  # raises InputError
    parts = series.frames // _MOST_FRAMES
    written = []
    for part, point in itertools.product(np.unique(parts), range(0, len(names), _MOST_TEXTS)):
        rows, columns = parts == part, slice(point, point + _MOST_TEXTS)
        begin = int(part) * _MOST_FRAMES
        ending = f"_frame{begin}" * (begin > 0) + f"_point{point}" * (point > 0)
        deviation = None if series.deviation is None else series.deviation[rows, columns]
        chunk = JointSeries(
            names[columns], series.joints[rows, columns], series.fps, series.frames[rows] - begin,
            deviation, series.note,
        )  # fmt: skip
        inside = [
            replace(event, time=event.time - begin / series.fps)
            for event in events
            if begin <= round(event.time * series.fps) < begin + _MOST_FRAMES
        ]
        written.append(path.with_stem(path.stem + ending))
        _write_part(written[-1], chunk, inside)
    return tuple(written)


def _write_part(path: Path, series: JointSeries, events: Sequence[C3dEvent]) -> None:
    """Write one file. Raises InputError if it cannot be written."""
    import ezc3d  # slow to import

    rate, rows = series.to_constant_rate()
    present = rows >= 0
    points = np.full((4, series.joints.shape[1], len(rows)), np.nan)
    points[:3, :, present] = 1000 * series.joints[rows[present]].transpose(2, 1, 0)
    points[3] = 1.0
    missing = np.isnan(points[:3]).any(0)
    residuals = np.zeros((1, *missing.shape))
    if series.deviation is not None:
        residuals[0][:, present] = np.nan_to_num(1000 * series.deviation[rows[present]].T)
    residuals[0][missing] = -1.0

    file: Any = ezc3d.c3d()
    names = list(series.joint_names)
    file["header"]["points"]["first_frame"] = int(series.frames[0])
    point = file["parameters"]["POINT"]
    point["RATE"]["value"], point["UNITS"]["value"] = [rate], ["mm"]
    point["LABELS"]["value"] = names
    point["DESCRIPTIONS"]["value"] = [name.replace("_", " ") for name in names]
    file.add_parameter("POINT", "X_SCREEN", "+X")
    file.add_parameter("POINT", "Y_SCREEN", "+Z")
    file.add_parameter("MANUFACTURER", "SOFTWARE", "psfs-apf")
    file.add_parameter("MANUFACTURER", "REMARK", series.note)
    _add_events(file, events)
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = residuals
    with write_atomically(path) as temporary, temporary_folder() as folder:
        plain = folder / "motion.c3d"  # ezc3d accepts only paths in UTF-8
        file.write(str(plain))
        shutil.copyfile(plain, temporary)


def _add_events(file: Any, events: Sequence[C3dEvent]) -> None:
    """Add the group EVENT, with times as minutes and seconds, of as many as the format counts."""
    if not events:
        return
    events = events[:_MOST_TEXTS]
    times = np.array([divmod(event.time, 60) for event in events]).T
    for name, value in (
        ("USED", [len(events)]),
        ("CONTEXTS", [event.context for event in events]),
        ("LABELS", [event.label for event in events]),
        ("TIMES", times),
    ):
        file.add_parameter("EVENT", name, value)
