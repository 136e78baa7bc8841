"""Cameras as other programs write them, for readers and for damage."""

import json
import math

import numpy as np

from helpers.footage import words
from psfs.cameras.camera import Camera, CameraRig


def middlebury(rig: CameraRig) -> str:
    lines = [f"{c.name}.png {words(c.K)} {words(c.R)} {words(c.t)}" for c in rig]
    return "\n".join([str(len(rig)), *lines])


def surrey(rig: CameraRig) -> str:
    text = f"{len(rig)} 1\n"
    for c in rig:
        lens = words([c.K[0, 0], c.K[1, 1], c.K[0, 2], c.K[1, 2], c.distortion[0]])
        text += f"0 {c.size[1] - 1} 0 {c.size[0] - 1}\n{lens}\n{words(c.R)}\n{words(c.t)}\n"
    return text


def humaneva(camera: Camera) -> str:
    """Positions in mm, skew relative to the focal length."""
    K = camera.K
    lens = [K[0, 0], K[1, 1], K[0, 2], K[1, 2], K[0, 1] / K[0, 0], *camera.distortion]
    return words(np.array([*lens, *camera.R.ravel(), *(1000 * camera.t), 0.1, 0.2, 0.3]))


def projection(camera: Camera) -> np.ndarray:
    return camera.K @ np.column_stack([camera.R, camera.t])


def projections(rig: CameraRig) -> str:
    return "\n".join(f"{c.name} {words(projection(c))}" for c in rig)


def nerf(rig: CameraRig, angle: bool = True) -> str:
    """The lens by its angle of view, or in pixels, whose first one's corner is 0."""
    frames = []
    for camera in rig:
        pose = np.eye(4)
        pose[:3, :3] = camera.R.T @ np.diag([1.0, -1, -1])
        pose[:3, 3] = camera.centre
        frames.append({"file_path": f"./{camera.name}", "transform_matrix": pose.tolist()})
    K, (width, height) = rig[0].K, rig[0].size
    lens = {"camera_angle_x": 2 * math.atan(width / 2 / K[0, 0])}
    if not angle:
        lens = {"fl_x": K[0, 0], "cx": K[0, 2] + 0.5, "cy": K[1, 2] + 0.5, "w": width, "h": height}
    return json.dumps({**lens, "frames": frames})
