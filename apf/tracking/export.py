"""Files of motion that other programs open, from a finished track."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from apf.formats import write_angle_csv
from apf.tracking.gait import Gait, gait_of
from apf.tracking.smoothing import SmoothingConfig, smoothed
from apf.tracking.track import Track
from cl import InputError
from psfs.cameras.names import listed
from psfs.common.files import write_json

#: What is written, and as what file.
EXPORTS = {
    "bvh": "motion.bvh",
    "c3d": "motion.c3d",
    "trc": "motion.trc",
    "mot": "motion.mot",
    "csv": "angles.csv",
    "glb": "motion.glb",
    "gait": "gait.json",
}


@dataclass(frozen=True, eq=False)
class Export:
    """What was written: the `files`, and the `track` that is in them. gait: None where it
    was not asked for or nobody walks, and then there is no file of it."""

    files: tuple[Path, ...]
    track: Track
    gait: Gait | None


def export(
    track: Track,
    folder: str | Path,
    to: Sequence[str] = tuple(EXPORTS),
    *,
    axes: str = "y-up",
    smoothing: SmoothingConfig | None = None,
    raw: bool = False,
) -> Export:
    """Write `track` into `folder`, as each of `to`, of EXPORTS.

    It is smoothed first, unless it is already or `raw` says not to. axes: of the TRC, see
    `Track.save`. Raises InputError for what is not in EXPORTS, for a track that does not hold its
    body, and where a file cannot be written.
    """
    for kind in to:
        if kind not in EXPORTS:
            raise InputError(f"a track is not exported as {kind!r}; expected {listed(EXPORTS)}")
    if not raw and track.smoothing is None:
        track = smoothed(track, smoothing)
    gait = gait_of(track) if "gait" in to else None
    files = []
    for kind in dict.fromkeys(to):
        path = Path(folder) / EXPORTS[kind]
        if kind == "csv":
            write_angle_csv(path, track.motion)
        elif kind != "gait":
            track.save(path, axes=axes) if kind == "trc" else track.save(path)
        elif gait is not None:
            write_json(path, gait.described())
        else:
            continue
        files.append(path)
    return Export(tuple(files), track, gait)
