"""Settings of a sequence that its files do not state: `sequence.toml`, or the same as flags."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator

from cl import InputError
from psfs.common.config import Config, setting
from psfs.common.files import name_file_in_errors, read_toml
from psfs.common.ranges import FARTHEST, check_name

#: How silhouettes are made. "gaussian": background model from pictures of the empty scene
#: (`background/`); "frames": the same, estimated from the sequence's own frames; "masks": given
#: masks; "threshold": brighter than `threshold` (0..1), then dilated and eroded; "mog": mixture of
#: Gaussians, fitted to the empty scene or, without it, to the sequence's own frames;
#: "mog-adaptive": one that is updated frame by frame; "mog-plain": that without detection of
#: shadows, which then count as the person; "chroma": a screen of one colour, `key` or
#: estimated from the empty scene or the frames.
BackgroundKind = Literal[
    "gaussian", "frames", "masks", "threshold", "mog", "mog-adaptive", "mog-plain", "chroma"
]
#: Those by a mixture of Gaussians.
MIXTURES = ("mog", "mog-adaptive", "mog-plain")

#: What is filmed. People stand on the floor and are 0.5 to 2.5 m tall; objects may be anything.
Subject = Literal["person", "object"]
#: Frames by which a camera may come late, or early, and the share by which its clock may differ.
_MAX_DELAY, _MAX_DRIFT = 1_000_000, 0.1

if TYPE_CHECKING:
    import numpy as np


def _checked(check: Callable[[Any], object]) -> AfterValidator:
    """Return what checks a stated key beside its type, and returns the value or a tidier one."""
    return AfterValidator(lambda value: None if value is None else check(value))


def _parsed(parse: str) -> AfterValidator:
    """Return what has a function, `module:name`, parse a stated key. It is imported when it is
    needed, for that takes a while."""

    def check(value: object) -> object:
        resolve_name(parse)(value)
        return value

    return _checked(check)


def _check_path(value: str | Path) -> object:
    if not str(value) or "\0" in str(value):
        raise InputError(f"calibration = {value!r}; expected a path")
    return value


def _check_cameras(value: tuple[str, ...]) -> object:
    if not value:
        raise InputError("cameras is empty; expected a list of names")
    names = tuple(check_name(name, "a camera in `cameras`") for name in value)
    if len(set(names)) < len(names):
        raise InputError(f"cameras = {', '.join(names)}; expected each of them once")
    return names


def _check_files(value: object) -> object:
    if not isinstance(value, Mapping) or not all(isinstance(of, str) for of in value.values()):
        raise InputError(f'files = {value!r}; expected a table, as [files] cam01 = "GOPR0012"')
    if len(set(value.values())) < len(value):
        raise InputError("files names a file twice; expected one of its own for each camera")
    return dict(value)


def _check_sync(value: object) -> object:
    if value in ("auto", "audio"):
        return value
    if not isinstance(value, Mapping):
        raise InputError(
            f"sync = {value!r}; expected auto, audio, or frames by camera, as {{cam03 = 5}}"
        )
    for name, delay in value.items():
        parts = delay if isinstance(delay, (list, tuple)) and len(delay) == 2 else (delay, 1)
        numbers = all(isinstance(n, (int, float)) and not isinstance(n, bool) for n in parts)
        if not (numbers and abs(parts[0]) <= _MAX_DELAY and abs(parts[1] - 1) <= _MAX_DRIFT):
            raise InputError(
                f"sync of {name} is {delay!r}; expected a number of frames, or that and its "
                f"clock's speed, {1 - _MAX_DRIFT:g} to {1 + _MAX_DRIFT:g}"
            )
    return dict(value)


def _check_volume(value: object) -> object:
    """Return (low, high), m with Z up; or {"own": (low, high)} in the file's axes and unit."""
    if isinstance(value, Mapping):
        if list(value) != ["own"]:
            raise InputError(f"volume has the keys {', '.join(map(str, value))}; expected own")
        low, high = _check_corners(value["own"], math.inf)
        return {"own": [low.tolist(), high.tolist()]}
    return _check_corners(value, FARTHEST)


def _check_corners(value: object, farthest: float) -> tuple[np.ndarray, np.ndarray]:
    import numpy as np

    try:
        plain = np.asarray(value)
        if plain.dtype.kind not in "iuf":
            raise ValueError
        low, high = plain.astype(np.float64).reshape(2, 3)
    except (TypeError, ValueError, OverflowError, RecursionError):
        raise InputError(
            f"volume = {value!r}; expected [[x0, y0, z0], [x1, y1, z1]] in metres"
        ) from None
    if not (np.isfinite([low, high]).all() and np.all(low < high)):
        raise InputError(f"volume from {low.tolist()} to {high.tolist()} m; expected low < high")
    if np.abs([low, high]).max() > farthest:
        raise InputError(
            f"volume from {low.tolist()} to {high.tolist()} m; "
            f"expected metres, up to {farthest:g} from the origin"
        )
    return low, high


class SequenceSettings(Config):
    """The keys of `sequence.toml`; None for those that are not stated."""

    unit: Annotated[str | float | None, _parsed("psfs.cameras.units:metres_per_unit")] = setting(
        None,
        "Unit of the calibration: m, cm, mm, 0.76mm or metres per unit.",
        "the calibration's own, else metres",
        flag="--unit",
        metavar="U",
    )
    up: Annotated[str | None, _parsed("psfs.cameras.units:rotation_to_z_up")] = setting(
        None,
        "Up axis of the calibration's world: z, -z, y, -y, x or -x.",
        "z",
        flag="--up",
        metavar="AXIS",
    )
    fps: float | None = setting(
        None,
        "Frame rate.",
        "the videos' own, else 30",
        "frames/s",
        least=0.001,
        most=100_000,
        flag="--fps",
        flag_help="frames per second, as 30 or 30000/1001",
        metavar="N",
    )
    background: BackgroundKind | None = setting(
        None, "How silhouettes are made.", "by what lies in the folder", flag="--background"
    )
    key: Annotated[str | None, _parsed("psfs.common.colours:parse_colour")] = setting(
        None,
        "The screen's colour, #rrggbb, where the background is `chroma`.",
        "found in the pictures",
        flag="--key",
        flag_help="the screen's colour for --background chroma",
        metavar="#rrggbb",
    )
    threshold: float | None = setting(
        None,
        "Brightness, 0 to 1, from which on a pixel is foreground where the background is "
        "`threshold`.",
        "to be stated",
        above=0,
        below=1,
        flag="--threshold",
        flag_help="brightness 0..1 for --background threshold",
        metavar="T",
    )
    dilate: int | None = setting(
        None, "Width by which such foreground is dilated.", "0", "px", least=0, most=1000
    )
    erode: int | None = setting(
        None, "Width by which such foreground is then eroded.", "0", "px", least=0, most=1000
    )
    volume: Annotated[Any, _checked(_check_volume)] = setting(
        None,
        "Box to reconstruct, [[x0, y0, z0], [x1, y1, z1]] with Z up, or {own = ...} in the "
        "calibration's unit and axes.",
        "found from the silhouettes",
        "m",
        flag="--volume",
        flag_help="the box to reconstruct, in metres with Z up; own:x0,... in the "
        "calibration's own unit and axes",
        metavar="x0,x1,y0,y1,z0,z1",
    )
    calibration: Annotated[str | Path | None, _checked(_check_path)] = setting(
        None,
        "Calibration file or folder, relative to the sequence's folder.",
        "found in the folder",
        flag="--calibration",
        flag_help="calibration file or folder",
        metavar="PATH",
    )
    cameras: Annotated[tuple[str, ...] | None, _checked(_check_cameras)] = setting(
        None,
        "Names of the cameras to use.",
        "all",
        flag="--cameras",
        flag_help="use only these cameras",
        metavar="A,B,C",
    )
    sync: Annotated[Any, _checked(_check_sync)] = setting(
        None,
        '"auto" (by the silhouettes), "audio" (by the sound of the videos), or by how many of its '
        "frames a camera comes late, by name; [frames, speed] if its clock runs differently.",
        "as many frames late as the files say",
        "frames",
        flag="--sync",
        flag_help="cameras that come N of their frames later than the others, or earlier "
        "(-N); auto: found in the pictures; audio: by the sound of the videos",
        metavar="auto|audio|CAMERA=N,...",
    )
    files: Annotated[Any, _checked(_check_files)] = setting(
        None,
        "Which video, or folder of pictures, is whose, by camera, where neither their names nor "
        "their order tells.",
        "by names, else by order",
    )
    subject: Subject | None = setting(
        None,
        "What is filmed: a person, who stands on the floor and is 0.5 to 2.5 m tall, or any "
        "object.",
        "person",
        flag="--subject",
    )
    take: Annotated[str | None, _checked(lambda take: check_name(take, "`take`"))] = setting(
        None,
        "Which of the takes in the folder, where it has several.",
        "to be stated",
        flag="--take",
        flag_help="which take of a folder with several (HumanEva's: Box_1)",
        metavar="NAME",
    )

    @classmethod
    def read(cls, path: Path) -> SequenceSettings:
        """Read the settings of a `sequence.toml`; all are None if there is no file."""
        if not path.exists():
            return cls()
        values = read_toml(path)
        with name_file_in_errors(path):
            return cls.from_dict(values)

    def fill_from(self, other: SequenceSettings) -> SequenceSettings:
        """Return these settings, with those that are not stated taken from `other`."""
        return other.replace(**{key: value for key, value in self if value is not None})


def split_delays(sync: object) -> dict[str, tuple[float, float]]:
    """Return by how many of its frames each camera of a checked `sync` is late, and how many
    seconds its clock counts in a second."""
    delays = sync.items() if isinstance(sync, Mapping) else ()
    return {name: tuple(by) if isinstance(by, (list, tuple)) else (by, 1) for name, by in delays}


def join_delays(delays: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    """Return the `sync` of `split_delays`; cameras without a delay are left out."""
    return {
        name: late if speed == 1 else [late, speed]
        for name, (late, speed) in delays.items()
        if (late, speed) != (0, 1)
    }
