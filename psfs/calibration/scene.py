"""The cameras and target poses that a calibration estimates, their reprojection errors, and the
world's axes: from a target on the floor, or from the cameras."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from cl import InputError
from psfs.calibration.targets.target import Sighting, Target
from psfs.cameras.camera import Camera

#: Error beyond which a sighting is left out before the last bundle adjustment; of all sightings:
#: beyond which the calibration has failed, px.
OUTLIER = 8.0
#: Error up to which a calibration is good, px: detectors reach 0.1 to 0.5; above which it is
#: unusable.
GOOD = 1.0
BAD = 3.0


@dataclass(frozen=True, eq=False)
class CalibrationScene:
    """Cameras in the order of the views, the target, and its pose (4, 4), target to world, of each
    frame."""

    cameras: tuple[Camera, ...]
    target: Target
    poses: dict[int, np.ndarray]

    def points(self, frame: int) -> np.ndarray:
        """Return the target's points (P, 3) m in the world."""
        return transform_points(self.poses[frame], self.target.frame_points(frame))

    def transform(self, world: np.ndarray) -> CalibrationScene:
        """Transform the scene to another world, x' = world x, (4, 4)."""
        poses = {frame: world @ pose for frame, pose in self.poses.items()}
        return CalibrationScene(transform_cameras(self.cameras, world), self.target, poses)


def transform_cameras(cameras: Iterable[Camera], world: np.ndarray) -> tuple[Camera, ...]:
    """Return the cameras in another world, x' = world x, (4, 4)."""
    inverse = np.linalg.inv(world)
    return tuple(place_camera(c, rigid_transform(c.R, c.t) @ inverse) for c in cameras)


def turn_to_up(up: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the axes (3, 3) with Z along `up` and X near `right`."""
    z = up / np.linalg.norm(up)
    x = right - z * (z @ right)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def transform_points(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Apply a rigid transform (4, 4) to points (N, 3)."""
    return points @ pose[:3, :3].T + pose[:3, 3]


def rigid_transform(R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Build a transform (4, 4) from a rotation (3, 3), or its Rodrigues vector, and a
    translation."""
    pose = np.eye(4)
    pose[:3, :3] = R if np.size(R) == 9 else cv2.Rodrigues(np.asarray(R, float))[0]
    pose[:3, 3] = np.ravel(t)
    return pose


def place_camera(camera: Camera, pose: np.ndarray) -> Camera:
    """Return the camera at `pose`, world to camera (4, 4)."""
    left, _, right = np.linalg.svd(pose[:3, :3])  # products of rotations drift
    return replace(camera, R=left @ right, t=pose[:3, 3])


def reprojection_errors(scene: CalibrationScene, sightings: Sequence[Sighting]) -> np.ndarray:
    """Return the errors (M,) px of all points of the sightings, concatenated."""
    errors: dict[int, np.ndarray] = {}
    for view in {sighting.view for sighting in sightings}:
        rows = [row for row, sighting in enumerate(sightings) if sighting.view == view]
        group = [sightings[row] for row in rows]
        points = np.concatenate([scene.points(s.frame)[s.ids] for s in group])
        pixels, _ = scene.cameras[view].project(points)
        away = np.linalg.norm(pixels - np.concatenate([s.pixels for s in group]), axis=-1)
        errors |= zip(
            rows, np.split(away, np.cumsum([len(s.ids) for s in group])[:-1]), strict=True
        )
    return np.concatenate([errors[row] for row in range(len(sightings))] or [np.zeros(0)])


def rms(values: np.ndarray) -> float:
    """Return the root mean square; NaN for an empty array."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("nan")


#: Largest deviation of the target's points from the floor plane, m, and their least extent across
#: their longest direction, as a share of that.
_MAX_DEVIATION, _MIN_EXTENT = 0.03, 0.05


def align_to_floor(scene: CalibrationScene, frames: Sequence[int], height: float) -> np.ndarray:
    """Return the transform (4, 4) to the world whose floor, Z = 0, the target lay on.

    frames: those in which the target lies on the floor; its points are `height` m above it. The
    origin is below the first point seen, X is the target's X axis. Raises InputError unless the
    points lie in a plane.
    """
    seen, target = [frame for frame in frames if frame in scene.poses], scene.target
    if not seen:
        raise InputError(
            f"the floor: the {target.name} is not seen, by enough cameras, in the frames stated; "
            f"expected frames in which it lies on the floor"
        )
    points = np.concatenate([scene.points(frame) for frame in seen])
    middle = points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(points - middle, full_matrices=False)
    if len(points) < 3 or sizes[1] < _MIN_EXTENT * sizes[0]:
        raise InputError(
            f"the floor: the {target.name} lies along one line in the frames stated; expected "
            "frames in which it lies on the floor in two directions"
        )
    off = float(np.abs((points - middle) @ axes[2]).max())
    if off > _MAX_DEVIATION:
        raise InputError(
            f"the floor: the points of the {target.name} lie {1000 * off:.0f} mm off a plane in "
            f"the frames stated; expected at most {1000 * _MAX_DEVIATION:.0f}"
        )
    first = scene.points(seen[0])
    across = first[-1] - first[0] if not target.planar else scene.poses[seen[0]][:3, 0]
    return _align_axes(scene, axes[2], across, first[0], height)


def align_to_cameras(scene: CalibrationScene) -> np.ndarray:
    """Return the transform (4, 4) to a world whose Z axis is the cameras' mean upward direction.

    The floor is at the target's lowest point, the origin below the mean of its points.
    """
    points = np.concatenate([scene.points(frame) for frame in scene.poses])
    middle = points.mean(axis=0)
    up = -np.mean([camera.R[1] for camera in scene.cameras], axis=0)
    if np.linalg.norm(up) < 0.1:  # the cameras look down from above
        up = np.mean([camera.centre for camera in scene.cameras], axis=0) - middle
    up = up / np.linalg.norm(up)
    lowest = middle + ((points - middle) @ up).min() * up
    first = scene.cameras[0]
    return _align_axes(scene, up, first.R[0], lowest, 0.0, towards_cameras=False)


def _align_axes(
    scene: CalibrationScene,
    normal: np.ndarray,
    across: np.ndarray,
    origin: np.ndarray,
    height: float,
    towards_cameras: bool = True,
) -> np.ndarray:
    """Return the transform (4, 4) to the axes with Z along `normal` and X along `across`.

    Z points to the cameras' side of the floor, and `origin` gets the coordinates (0, 0, height).
    """
    centres = np.array([camera.centre for camera in scene.cameras])
    if towards_cameras and ((centres - origin) @ normal).mean() < 0:
        normal = -normal
    R = turn_to_up(normal, across)
    return rigid_transform(R, np.array([0, 0, height]) - origin @ R.T)
