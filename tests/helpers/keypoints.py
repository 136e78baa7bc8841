"""Keypoints of a known body, as a network without errors would detect them."""

import numpy as np

from apf.body.kinematics import bone_matrices
from apf.body.model import BodyModel
from apf.keypoints.keypoints import Keypoints
from apf.keypoints.landmarks import locate_points
from apf.keypoints.readers.orders import MEDIAPIPE
from psfs.cameras.camera import CameraRig


def of_poses(
    rig: CameraRig,
    body: BodyModel,
    poses: np.ndarray,
    names: tuple[str, ...] = MEDIAPIPE,
    noise: float = 0.0,
    seed: int = 0,
) -> Keypoints:
    """Keypoints of `body` in poses (F, D), at their prior places, `noise` px from where they are
    seen; those that the body has no point for are missing."""
    random = np.random.default_rng(seed)
    places = world_points(body, poses, names)
    points = np.full((len(rig), len(poses), len(names), 3), np.nan)
    for view, camera in enumerate(rig):
        pixels, depth = camera.project(places)
        seen = (depth > 0) & np.isfinite(places).all(-1)
        pixels += random.normal(0, noise, pixels.shape)
        score = random.uniform(0.5, 1, seen.shape)
        points[view][seen] = np.column_stack([pixels[seen], score[seen]])
    return Keypoints(points, names, tuple(rig.names))


def world_points(body: BodyModel, poses: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """Return the keypoints' positions (F, K, 3) m; NaN for those that the body lacks."""
    on = locate_points(body, names)
    rotations, origins = bone_matrices(body, poses)
    places = np.full((len(poses), len(names), 3), np.nan)
    places[:, on.columns] = origins[:, on.bones] + np.einsum(
        "fpab,pb->fpa", rotations[:, on.bones], on.offsets
    )
    return places
