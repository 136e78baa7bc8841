"""Settings of a sequence that its files do not state: `sequence.toml`, or the same as flags."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from cl import InputError
from psfs.cameras.calibration.common import name_file_in_errors
from psfs.cameras.names import listed
from psfs.cameras.units import Unit, metres_per_unit, rotation_to_z_up
from psfs.common.colours import parse_colour
from psfs.common.names import check_name
from psfs.common.ranges import check_range
from psfs.common.toml import read_toml

#: How silhouettes are made. "gaussian": background model from pictures of the empty scene
#: (`background/`); "frames": the same, estimated from the sequence's own frames; "masks": given
#: masks; "threshold": brighter than `threshold` (0..1), then dilated and eroded; "mog": mixture of
#: Gaussians, fitted to the empty scene or, without it, to the sequence's own frames;
#: "mog-adaptive": one that is updated frame by frame; "chroma": a screen of one colour, `key` or
#: estimated from the empty scene or the frames.
BACKGROUND_KINDS = ("gaussian", "frames", "masks", "threshold", "mog", "mog-adaptive", "chroma")
#: The kinds that use a mixture of Gaussians.
MIXTURES = ("mog", "mog-adaptive")
#: Largest coordinate of a corner of the volume, m.
_MAX_COORDINATE = 10_000.0

#: What is filmed. People stand on the floor and are 0.5 to 2.5 m tall; objects have any size.
SUBJECTS = ("person", "object")
#: Most frames by which a camera may be late or early.
_MAX_DELAY = 1_000_000


@dataclass(frozen=True)
class Settings:
    """The keys of `sequence.toml`; None for those that are not stated.

    unit: of the calibration. up: axis of the calibration's world. fps: frames per second. sync:
    "auto", or by how many of its own frames each camera is late, by name. subject: "person" or
    "object", what is filmed. background: one of `BACKGROUND_KINDS`. key: the screen's colour,
    "#rrggbb". threshold: 0..1. dilate, erode: pixels. volume: ((x0, y0, z0), (x1, y1, z1)) in
    metres, Z up. calibration: path, relative to the folder. cameras: names of those to use. take:
    which of several takes in the folder.
    """

    unit: Unit | None = None
    up: str | None = None
    fps: float | None = None
    background: str | None = None
    key: str | None = None
    threshold: float | None = None
    dilate: int | None = None
    erode: int | None = None
    volume: Any = None
    calibration: str | None = None
    cameras: tuple[str, ...] | None = None
    sync: Any = None
    subject: str | None = None
    take: str | None = None

    def __post_init__(self) -> None:
        if self.unit is not None:
            metres_per_unit(self.unit)
        if self.up is not None:
            rotation_to_z_up(self.up)
        if self.fps is not None:
            check_range("fps", self.fps, 0.001, 100_000, ends=True)
        if self.sync is not None:
            object.__setattr__(self, "sync", _check_sync(self.sync))
        if self.subject is not None and self.subject not in SUBJECTS:
            raise InputError(f"subject = {self.subject!r}; expected {listed(SUBJECTS)}")
        if self.threshold is not None:
            check_range("threshold", self.threshold, 0, 1)
        for key in ("dilate", "erode"):
            if getattr(self, key) is not None:
                check_range(key, getattr(self, key), 0, 1000, ends=True)
            value = getattr(self, key)
            if value is not None and not isinstance(value, int):
                raise InputError(f"{key} is {value!r}; expected a whole number of pixels")
        if not isinstance(self.background, str | None) or (
            self.background not in (None, *BACKGROUND_KINDS)
        ):
            raise InputError(
                f"background = {self.background!r}; expected {listed(BACKGROUND_KINDS)}"
            )
        if self.take is not None:
            check_name(self.take, "`take`")
        if self.key is not None:
            parse_colour(self.key)
        if self.calibration is not None:
            _check_path(self.calibration)
        if self.volume is not None:
            object.__setattr__(self, "volume", _check_volume(self.volume))
        if self.cameras is not None:
            if not isinstance(self.cameras, list | tuple) or not self.cameras:
                raise InputError(f"cameras = {self.cameras!r}; expected a list of names")
            names = tuple(check_name(name, "a camera in `cameras`") for name in self.cameras)
            if len(set(names)) < len(names):
                raise InputError(f"cameras = {listed(names)}; expected each of them once")
            object.__setattr__(self, "cameras", names)

    @classmethod
    def of(cls, values: dict[str, Any]) -> Settings:
        """Build the settings from a mapping. Raises InputError for unknown keys and bad values."""
        known = [field.name for field in fields(cls)]
        unknown = [str(key) for key in values if key not in known]
        if unknown:
            raise InputError(f"unknown key {listed(unknown)}; expected {listed(known)}")
        return cls(**values)

    @classmethod
    def read(cls, path: Path) -> Settings:
        """Read a `sequence.toml`; all settings are None if there is none."""
        if not path.exists():
            return cls()
        values = read_toml(path)
        with name_file_in_errors(path):
            return cls.of(values)

    def over(self, other: Settings) -> Settings:
        """Return these settings, filled with `other`'s where these are None."""
        stated = {key: value for key, value in vars(self).items() if value is not None}
        return replace(other, **stated)


def _check_path(value: Any) -> None:
    if not isinstance(value, str | Path) or not str(value) or "\0" in str(value):
        raise InputError(f"calibration = {value!r}; expected a path")


def _check_sync(value: Any) -> Any:
    if value == "auto":
        return value
    if not isinstance(value, Mapping):
        raise InputError(f"sync = {value!r}; expected auto, or frames by camera, as {{cam03 = 5}}")
    for name, late in value.items():
        if not isinstance(late, int) or isinstance(late, bool) or abs(late) > _MAX_DELAY:
            raise InputError(f"sync of {name} is {late!r}; expected a whole number of frames")
    return dict(value)


def _check_volume(value: Any) -> Any:
    """Return (low, high), m with Z up; or {"own": (low, high)} in the file's axes and unit."""
    if isinstance(value, Mapping):
        if list(value) != ["own"]:
            raise InputError(f"volume has the keys {listed(map(str, value))}; expected own")
        low, high = _check_corners(value["own"], math.inf)
        return {"own": [low.tolist(), high.tolist()]}
    return _check_corners(value, _MAX_COORDINATE)


def _check_corners(value: Any, farthest: float) -> tuple[np.ndarray, np.ndarray]:
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
