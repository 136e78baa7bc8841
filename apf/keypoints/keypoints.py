"""2-D keypoints of a person in every camera and frame, as pose networks detect them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from apf.keypoints.association import associate_people, choose_person, count_at_once
from apf.keypoints.opening import Cameras, get_rig, match_persons, read_raw
from apf.keypoints.readers.raw import check_view
from cl import InputError
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.names import join_names
from psfs.cameras.triangulation import (
    Triangulation,
    TriangulationConfig,
    triangulate,
    undistort_points,
)
from psfs.common.numbers import STEP_SECONDS
from psfs.sequence import DEFAULT_FPS
from psfs.sequence import Sequence as Footage

__all__ = ["Keypoints", "Triangulation", "TriangulationConfig", "triangulate"]


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Keypoints of one person.

    points: (V, F, K, 3) float32 = x, y in pixels of the original (distorted) picture, pixel centres
    at integers, and confidence 0..1; NaN where missing. names: (K,) as their file or network calls
    them. camera_names: (V,). notes: remarks on what was guessed or left out when reading. Raises
    InputError if shapes contradict or a number is out of range.
    """

    points: np.ndarray
    names: tuple[str, ...]
    camera_names: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        set_ = object.__setattr__  # required in a frozen dataclass
        set_(self, "names", tuple(map(str, self.names)))
        set_(self, "camera_names", tuple(map(str, self.camera_names)))
        points = np.array(self.points)
        expected = (len(self.camera_names), len(self.names), 3)
        if points.dtype.kind not in "fiu":
            raise InputError(f"keypoints are of type {points.dtype}; expected numbers")
        if points.ndim != 4 or (points.shape[0], *points.shape[2:]) != expected:
            raise InputError(
                f"keypoints have shape {points.shape}; expected ({expected[0]} cameras, frames, "
                f"{expected[1]} names, 3: x, y, confidence)"
            )
        if len(set(self.names)) < len(self.names):
            raise InputError(f"keypoint names must differ; found {join_names(self.names)}")
        points = points.astype(np.float32)
        check_view("keypoints", points)
        points[np.isnan(points).any(-1) | (points[..., 2] == 0)] = np.nan
        points[..., 2] = np.minimum(points[..., 2], 1)
        set_(self, "points", points)

    @property
    def n_frames(self) -> int:
        """Number of frames F."""
        return self.points.shape[1]

    @classmethod
    def open(cls, path: str | Path, cameras: Cameras | None = None) -> Keypoints:
        """Read the keypoints in a file or folder of any supported format.

        cameras: a sequence, a rig or names, to which the keypoints' cameras are matched by name,
        else by order. The result has these cameras in their order, with NaN for those without
        keypoints; with a sequence it also has its number of frames. Raises InputError, or
        MissingFileError if there is nothing.
        """
        raw = read_raw(Path(path))
        points, names, notes = match_persons(raw, cameras)
        n_persons = points.shape[2]
        if n_persons > 1:
            notes.append(
                f"{raw.path}: up to {n_persons} persons in a picture: one is followed that is "
                "sure, large and seen alike by all cameras"
            )
        fps = cameras.fps if isinstance(cameras, Footage) else DEFAULT_FPS
        one = choose_person(points, get_rig(cameras), fps)
        return cls(one, raw.names, names, tuple(notes))

    @classmethod
    def open_people(
        cls, path: str | Path, sequence: Footage, number: int | Literal["auto"] | None = None
    ) -> list[Keypoints]:
        """Read the keypoints of several people in the pictures of a sequence; return those of each,
        the longest seen first; see `associate_people`. number: of people at most; "auto" for as
        many as are seen at once for a while. Raises InputError, also if nobody is seen alike by
        several cameras, or MissingFileError."""
        raw = read_raw(Path(path))
        points, names, notes = match_persons(raw, sequence)
        most = None if number == "auto" else number
        people = associate_people(points, sequence.rig, sequence.fps, most)
        if number == "auto":
            most = count_at_once(people, STEP_SECONDS * sequence.fps)
            if 0 < most < len(people):
                people = associate_people(points, sequence.rig, sequence.fps, most)
        if not people:
            raise InputError(f"{path}: no person is seen alike by several cameras")
        return [cls(person, raw.names, names, tuple(notes)) for person in people]

    def select_cameras(self, names: Sequence[str]) -> Keypoints:
        """Return the keypoints of these cameras, in this order. Raises InputError."""
        unknown = [name for name in names if name not in self.camera_names]
        if unknown:
            raise InputError(
                f"no keypoints of camera {join_names(unknown)}; there are some of "
                f"{join_names(self.camera_names)}"
            )
        rows = [self.camera_names.index(name) for name in names]
        return replace(self, points=self.points[rows], camera_names=tuple(names))

    def undistort(self, cameras: CameraRig | Sequence[Camera]) -> Keypoints:
        """Return the keypoints as the same cameras without distortion would see them.

        cameras: one for each of `camera_names`, in this order. Points that cannot be undistorted
        become missing. Raises InputError.
        """
        names = tuple(camera.name for camera in cameras)
        if names != self.camera_names:
            raise InputError(
                f"cameras are {join_names(names)}; expected those of the keypoints, "
                f"{join_names(self.camera_names)}"
            )
        return replace(self, points=undistort_points(cameras, self.points))
