"""Find out whether left and right are exchanged in all cameras."""

from __future__ import annotations

import numpy as np

from apf.keypoints.config import SideConfig
from apf.keypoints.keypoints import Keypoints
from apf.keypoints.landmarks import find_landmarks
from psfs.cameras.camera import CameraRig
from psfs.cameras.triangulation import TriangulationConfig, triangulate
from psfs.common.numbers import pick_evenly


def faces_backward(keypoints: Keypoints, rig: CameraRig, config: SideConfig | None = None) -> bool:
    """Return whether the person would look and step backward.

    Forward is perpendicular to the trunk and to the line from the right to the left shoulder, or
    hip. Keypoints whose left and right are exchanged in all cameras fit each other as well as
    before, but the nose lies behind the ears and the toes behind the heels.
    """
    config = config or SideConfig()
    points = _triangulate(keypoints, rig, config)

    def point(name: str) -> np.ndarray:
        unknown = np.full((1, 3), np.nan)
        return points.get(name, unknown)

    def middle(name: str) -> np.ndarray:
        return 0.5 * (point(f"l_{name}") + point(f"r_{name}"))

    up = middle("shoulder") - middle("hip")
    towards = {
        name: np.cross(point(f"l_{name}") - point(f"r_{name}"), up) for name in ("shoulder", "hip")
    }
    votes = [_forward(point("nose") - middle("ear"), towards["shoulder"])]
    for side in ("l", "r"):
        back = f"{side}_heel" if f"{side}_heel" in points else f"{side}_ankle"
        votes.append(_forward(point(f"{side}_big_toe") - point(back), towards["hip"]))
    known = [vote for vote in votes if len(vote) >= config.least_frames]
    return bool(known) and all(float(np.mean(vote < 0)) > config.backward for vote in known)


def _triangulate(keypoints: Keypoints, rig: CameraRig, config: SideConfig) -> dict[str, np.ndarray]:
    """Return the points (F, 3) m of some frames by their landmarks' names; NaN where unknown."""
    rows = pick_evenly(keypoints.n_frames, config.n_frames)
    seen = keypoints.undistort(rig).points[:, rows]
    limits = TriangulationConfig(max_error=config.error * rig.height)
    landmarks = find_landmarks(keypoints.names)
    places = triangulate(rig, seen[:, :, list(landmarks)], limits).points
    return {landmark.name: places[:, k] for k, landmark in enumerate(landmarks.values())}


def _forward(step: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """Return the known ones (n,) of the products of steps (F, 3) and directions (F, 3)."""
    products: np.ndarray = (step * towards).sum(-1)
    return products[np.isfinite(products)]
