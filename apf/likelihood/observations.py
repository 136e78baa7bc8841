"""Points of the body as cameras see them in one frame: keypoints, optical flow, markers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeAlias, TypeVar

import numpy as np

from apf.body.model import BodyModel
from apf.scene import Scene
from cl import Array, InputError
from cl.staging import Upload
from psfs.cameras.camera import CameraRig
from psfs.voxels.device_voxels import Voxels
from psfs.voxels.host_voxels import HostVoxels

#: Numbers of a row of the packed table, see observed.h.
OBSERVED_FLOATS = 12


@dataclass(frozen=True, eq=False)
class PointObservations:
    """N sightings of P points that are fixed to the body, in one frame.

    bone: (P,) int that each point is on. position: (P, 3) m in its frame. point: (N,) int, which of
    them was seen. partner: (N,) int, the point that it may have been taken for, a left one for the
    right one; -1 for none. camera: (N,) int. pixel: (N, 2), undistorted. inverse_scale: (N,) 1 /
    px, of the error of a coordinate. most: sightings there could have been; N where not stated.
    usual: as many as a frame usually has; 0 where that is not known.
    Raises InputError where shapes disagree or a number makes no sense.
    """

    bone: np.ndarray
    position: np.ndarray
    point: np.ndarray
    partner: np.ndarray
    camera: np.ndarray
    pixel: np.ndarray
    inverse_scale: np.ndarray
    most: float = 0.0
    usual: float = 0.0

    def __post_init__(self) -> None:
        n_points, n = np.size(self.bone), np.size(self.point)
        shapes = {"bone": (n_points,), "position": (n_points, 3), "point": (n,), "partner": (n,),
                  "camera": (n,), "pixel": (n, 2), "inverse_scale": (n,)}  # fmt: skip
        for name, shape in shapes.items():
            kind = float if name in ("position", "pixel", "inverse_scale") else np.intp
            value = np.asarray(getattr(self, name), kind)
            if value.shape != shape:
                raise InputError(f"observed points: {name} is {value.shape}; expected {shape}")
            object.__setattr__(self, name, value)
        if not (np.isfinite(self.position).all() and np.isfinite(self.pixel).all()):
            raise InputError("observed points: a place is not finite; expected missing ones absent")
        if not (np.isfinite(self.inverse_scale).all() and np.all(self.inverse_scale >= 0)):
            raise InputError("observed points: an inverse scale is not 0 or positive")
        last = max(self.point.max(), self.partner.max()) if n else -1
        if n and not (self.point.min() >= 0 and last < n_points):
            raise InputError(f"observed points: expected numbers of the {n_points} points")
        object.__setattr__(self, "most", float(max(self.most, n)))

    def __len__(self) -> int:
        return len(self.point)

    @property
    def few(self) -> bool:
        """Whether there are less than half as many as usual, too few to say that somebody is
        elsewhere: what two cameras of six see wrongly fits some pose, too."""
        return len(self) < 0.5 * self.usual

    def check(self, body: BodyModel, rig: CameraRig) -> None:
        """Raise InputError unless all bones and cameras are those of `body` and `rig`."""
        for what, numbers, n in (
            ("bone", self.bone, len(body.bones)),
            ("camera", self.camera, len(rig)),
        ):
            if len(numbers) and not (numbers.min() >= 0 and numbers.max() < n):
                raise InputError(
                    f"observed points: {what}s {numbers.min()} to {numbers.max()}; expected "
                    f"0 to {n - 1}"
                )

    def pack(self, table: np.ndarray) -> int:
        """Write the table of observed.h, float32, into one with room for it; return how many
        numbers of it that takes."""
        n = 4 + OBSERVED_FLOATS * len(self)
        table[:4] = len(self), self.most, 0, 0
        rows = table[4:n].reshape(len(self), OBSERVED_FLOATS)
        rows[:, 0], rows[:, 1:4] = self.bone[self.point], self.position[self.point]
        rows[:, 4] = np.where(self.partner >= 0, self.bone[self.partner], -1)
        rows[:, 5:8] = self.position[self.partner]
        rows[:, 8:10], rows[:, 10], rows[:, 11] = self.pixel, self.inverse_scale, self.camera
        return n


def no_observations() -> PointObservations:
    """Return none at all."""
    none = np.zeros(0, int)
    return PointObservations(
        none, np.zeros((0, 3)), none, none, none, np.zeros((0, 2)), np.zeros(0)
    )


def joined(parts: Sequence[PointObservations]) -> PointObservations:
    """Return all of `parts` as one, keypoints and optical flow say."""
    if not parts:
        return no_observations()
    first = np.cumsum([0, *[len(part.bone) for part in parts[:-1]]])

    def numbers(name: str) -> np.ndarray:
        values = [getattr(part, name) for part in parts]
        moved = [np.where(v >= 0, v + n, v) for v, n in zip(values, first, strict=True)]
        return np.concatenate(moved)

    def all_of(name: str) -> np.ndarray:
        return np.concatenate([getattr(part, name) for part in parts])

    return PointObservations(
        all_of("bone"), all_of("position"), numbers("point"), numbers("partner"),
        all_of("camera"), all_of("pixel"), all_of("inverse_scale"),
        sum(part.most for part in parts), sum(part.usual for part in parts),
    )  # fmt: skip


A = TypeVar("A", covariant=True)


class FeatureMaps(Protocol[A]):
    """Image features of a frame: arrays on the device, or NumPy's for the twin."""

    @property
    def maps(self) -> A:
        """(V, H, W, 2) uint8 silhouette 0 or 255 and edge proximity 0..255."""

    @property
    def roi(self) -> A:
        """(V, 4) int32 first column and row and, excluded, the last; what lies outside counts
        nowhere."""


#: What is made of a frame's pictures for a tracker; None where it looks at keypoints alone.
Shown: TypeAlias = Voxels | HostVoxels | FeatureMaps[Array] | FeatureMaps[np.ndarray] | None


class Observed(NamedTuple):
    """What a tracker with keypoints is shown of a frame: voxels or image features, None where it
    looks at keypoints alone; and points of the body, None where nothing is known of them."""

    shown: Any
    points: PointObservations | None


#: What a tracker observes of a frame.
Observation: TypeAlias = Shown | Observed


def with_points(observation: Any, points: PointObservations | None) -> Any:
    """Return an observation with `points`, if there are any."""
    return observation if points is None else Observed(observation, points)


def parted(observation: Observation) -> Observed:
    """Return an observation, of whatever kind, as the two parts of `Observed`."""
    return observation if isinstance(observation, Observed) else Observed(observation, None)


class ObservedPoints:
    """A frame's points on the device: `table`, see observed.h, with room for `room` sightings, and
    the `cameras` that see them."""

    def __init__(self, scene: Scene, room: int) -> None:
        device = scene.opencl
        self._rig, self._body, self.room = scene.rig, scene.body, room
        self.cameras = device.to_device(scene.rig.packed(), "the cameras")
        size = 4 + OBSERVED_FLOATS * room
        self.table = device.empty((size,), np.float32, "the observed points")
        self._upload = Upload(self.table)
        self.set(no_observations())

    def set(self, observations: PointObservations) -> None:
        """Enqueue the upload of a frame's points. Raises InputError for those of another body or
        rig, and where there are more than fit."""
        observations.check(self._body, self._rig)
        if len(observations) > self.room:
            raise InputError(
                f"{len(observations)} observed points in a frame; expected at most "
                f"keypoints_room = {self.room}"
            )
        self._upload.start(observations.pack(self._upload.room()))
