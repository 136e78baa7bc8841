"""The cameras and target poses that a calibration estimates, and their reprojection errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from psfs.calibration.targets.target import Sighting, Target
from psfs.cameras.camera import Camera

#: Error beyond which a sighting is left out before the last bundle adjustment; of all sightings:
#: beyond which the calibration has failed, px.
OUTLIER = 8.0
#: Error up to which a calibration is good, px: detectors reach 0.1 to 0.5.
GOOD = 1.0


@dataclass(frozen=True, eq=False)
class CalibrationScene:
    """Cameras in the order of the views, and the target's pose (4, 4), target to world, of each
    frame."""

    cameras: tuple[Camera, ...]
    poses: dict[int, np.ndarray]

    def points(self, target: Target, frame: int) -> np.ndarray:
        """Return the target's points (P, 3) m in the world."""
        return transform_points(self.poses[frame], target.frame_points(frame))

    def transform(self, world: np.ndarray) -> CalibrationScene:
        """Transform the scene to another world, x' = world x, (4, 4)."""
        inverse = np.linalg.inv(world)
        cameras = tuple(
            place_camera(camera, camera_pose(camera) @ inverse) for camera in self.cameras
        )
        return CalibrationScene(
            cameras, {frame: world @ pose for frame, pose in self.poses.items()}
        )


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


def camera_pose(camera: Camera) -> np.ndarray:
    """Return the transform (4, 4) from the world to the camera."""
    return rigid_transform(camera.R, camera.t)


def place_camera(camera: Camera, pose: np.ndarray) -> Camera:
    """Return the camera at `pose`, world to camera (4, 4)."""
    left, _, right = np.linalg.svd(pose[:3, :3])  # products of rotations drift
    return replace(camera, R=left @ right, t=pose[:3, 3])


def reprojection_errors(scene: CalibrationScene, target: Target, sighting: Sighting) -> np.ndarray:
    """Return the reprojection errors (N,) px of a sighting."""
    points = scene.points(target, sighting.frame)[sighting.ids]
    pixels, _ = scene.cameras[sighting.view].project(points)
    return np.linalg.norm(pixels - sighting.pixels, axis=-1)


def all_reprojection_errors(
    scene: CalibrationScene, target: Target, sightings: Sequence[Sighting]
) -> np.ndarray:
    """Return the errors (M,) px of all points of the sightings, concatenated."""
    found: dict[int, np.ndarray] = {}
    for view in {sighting.view for sighting in sightings}:
        rows = [row for row, sighting in enumerate(sightings) if sighting.view == view]
        own = [sightings[row] for row in rows]
        points = np.concatenate([scene.points(target, s.frame)[s.ids] for s in own])
        pixels, _ = scene.cameras[view].project(points)
        away = np.linalg.norm(pixels - np.concatenate([s.pixels for s in own]), axis=-1)
        found |= zip(rows, np.split(away, np.cumsum([len(s.ids) for s in own])[:-1]), strict=True)
    return np.concatenate([found[row] for row in range(len(sightings))] or [np.zeros(0)])


def rms(values: np.ndarray) -> float:
    """Return the root mean square; NaN for an empty array."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("nan")
