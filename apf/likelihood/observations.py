"""Observed points of the body in one frame: keypoints, optical flow, markers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeAlias, TypeVar

import numpy as np

from apf.body.model import BodyModel
from apf.scene import Scene
from cl import Array, InputError
from cl.staging import Upload
from psfs.cameras.camera import CameraRig
from psfs.voxels.device_voxels import CarvedVoxels
from psfs.voxels.host_voxels import HostVoxels

#: Numbers of a row of the packed table, see observed.h.
OBSERVED_FLOATS = 12
#: Distance, in standard deviations, at which the cost of a point is half its maximum of 1 (Geman &
#: McClure 1987).
POINT_REACH = 5.0


@dataclass(frozen=True, eq=False)
class PointObservations:
    """N sightings of P points that are fixed to the body, in one frame.

    bone: (P,) int, bone of each point. position: (P, 3) m in the bone's frame. point: (N,) int, the
    point of each sighting. partner: (N,) int, the point that it may be confused with, as left with
    right; -1 for none. camera: (N,) int. pixel: (N, 2) undistorted px. inverse_scale: (N,) inverse
    error of a coordinate, 1 / px. most: largest possible number of sightings, at least N. usual:
    usual number of sightings in a frame; 0 if unknown.
    Raises InputError if shapes disagree or a value is invalid.
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
        """Whether there are less than half as many sightings as usual. They are then too few to
        locate a person elsewhere: wrong detections in two of six cameras also fit some pose."""
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
        """Write the packed table of observed.h to `table`, float32; return the number of values
        written."""
        n = 4 + OBSERVED_FLOATS * len(self)
        table[:4] = len(self), self.most, 0, 0
        rows = table[4:n].reshape(len(self), OBSERVED_FLOATS)
        rows[:, 0], rows[:, 1:4] = self.bone[self.point], self.position[self.point]
        rows[:, 4] = np.where(self.partner >= 0, self.bone[self.partner], -1)
        rows[:, 5:8] = self.position[self.partner]
        rows[:, 8:10], rows[:, 10], rows[:, 11] = self.pixel, self.inverse_scale, self.camera
        return n


def make_empty_observations() -> PointObservations:
    """Return an empty set of observations."""
    none = np.zeros(0, int)
    return PointObservations(
        none, np.zeros((0, 3)), none, none, none, np.zeros((0, 2)), np.zeros(0)
    )


A = TypeVar("A", covariant=True)


class FeatureMaps(Protocol[A]):
    """Image features of a frame: arrays on the device, or NumPy's for the twin."""

    @property
    def maps(self) -> A:
        """(V, H, W, 2) uint8 silhouette 0 or 255 and edge proximity 0..255."""

    @property
    def roi(self) -> A:
        """(V, 4) int32 regions of interest x0, y0, x1, y1, the ends excluded; pixels outside are
        not counted."""


#: Voxels as trackers take them.
AnyVoxels: TypeAlias = CarvedVoxels | HostVoxels
#: Observation that is computed from a frame's pictures; None if a tracker uses keypoints alone.
Shown: TypeAlias = AnyVoxels | FeatureMaps[Array] | FeatureMaps[np.ndarray] | None


class Observed(NamedTuple):
    """Observation of a tracker with keypoints: voxels or image features (None if it uses keypoints
    alone), and observed points of the body (None if there are none)."""

    shown: Shown
    points: PointObservations | None


#: Observation of a frame, as trackers take it.
Observation: TypeAlias = Shown | Observed


def with_points(observation: Observation, points: PointObservations | None) -> Observation:
    """Add `points`, if they are not None, to an observation, in place of its own."""
    return observation if points is None else Observed(split_observation(observation).shown, points)


def split_observation(observation: Observation) -> Observed:
    """Return any observation as an `Observed`."""
    return observation if isinstance(observation, Observed) else Observed(observation, None)


class ObservedPoints:
    """Observed points of a frame on the device: the `table` of observed.h, with room for `room`
    sightings, and the packed `cameras`."""

    def __init__(self, scene: Scene, room: int) -> None:
        device = scene.opencl
        self._rig, self._body, self.room = scene.rig, scene.body, room
        self.cameras = device.to_device(scene.rig.packed(), "the cameras")
        size = 4 + OBSERVED_FLOATS * room
        self.table = device.empty((size,), np.float32, "the observed points")
        self._upload = Upload(self.table)
        self.set(make_empty_observations())

    def set(self, observations: PointObservations) -> None:
        """Enqueue the upload of a frame's points. Raises InputError if they belong to another body
        or rig, or if there are more than `room`."""
        observations.check(self._body, self._rig)
        if len(observations) > self.room:
            raise InputError(
                f"{len(observations)} observed points in a frame; expected at most "
                f"keypoints_room = {self.room}"
            )
        self._upload.start(observations.pack(self._upload.room()))


@dataclass(frozen=True, eq=False)
class KeypointModel:
    """Model of P body points among the K keypoints that a network finds in each of V cameras.

    columns: (P,) int, index of each point among the K keypoints. bone: (P,) int, bone of each
    point. position: (P, 3) m in the bone's frame. partner: (P,) int, the same point on the other
    side of the body, -1 on the midline. confidence, error: (B,) ascending confidences, and the
    error of a coordinate there, px; linear in between. factor: (P,) multiplies the error, as some
    points are harder to find. usual: usual number of points in a frame, summed over all cameras; 0
    if unknown.
    """

    columns: np.ndarray
    bone: np.ndarray
    position: np.ndarray
    partner: np.ndarray
    confidence: np.ndarray
    error: np.ndarray
    factor: np.ndarray
    usual: float = 0.0

    def scale(self, confidence: np.ndarray) -> np.ndarray:
        """Return the error of a coordinate (..., P), px, at confidences (..., P)."""
        return np.interp(confidence, self.confidence, self.error) * self.factor

    def observations(self, keypoints: np.ndarray) -> PointObservations:
        """Convert the keypoints of one frame to observed points of the body.

        keypoints: (V, K, 3) undistorted px and confidence; NaN where missing."""
        seen = np.asarray(keypoints, np.float64)[:, self.columns]
        camera, point = np.nonzero(np.isfinite(seen).all(-1) & (seen[..., 2] > 0))
        scale = self.scale(np.nan_to_num(seen[..., 2]))
        return PointObservations(
            bone=self.bone,
            position=self.position,
            point=point,
            partner=self.partner[point],
            camera=camera,
            pixel=seen[camera, point, :2],
            inverse_scale=1 / scale[camera, point],
            most=seen.shape[0] * seen.shape[1],
            usual=self.usual,
        )
