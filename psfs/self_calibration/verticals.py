"""Up from the vertical edges of the room, as the empty scene shows them.

Corners of walls, door frames and cupboards are vertical. An edge in a picture and the camera's
centre span a plane which contains the edge's direction: up is the direction that most planes of all
cameras contain, their common vanishing point (Barnard, Artificial Intelligence 21, 1983; Kosecka &
Zhang, ECCV 2002). Edges are line segments (von Gioi et al., PAMI 32, 2010).
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.self_calibration.config import VerticalConfig


def find_edges(picture: np.ndarray, config: VerticalConfig) -> np.ndarray:
    """Return the ends (N, 2, 2) px of the straight edges in a picture (h, w, 3) uint8."""
    found = cv2.createLineSegmentDetector().detect(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY))[0]
    ends = np.zeros((0, 2, 2)) if found is None else found.reshape(-1, 2, 2).astype(float)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return ends[lengths > config.shortest * max(picture.shape[:2])]


def fit_vertical(
    rig: CameraRig, edges: Sequence[np.ndarray], up: np.ndarray, config: VerticalConfig
) -> np.ndarray | None:
    """Return the direction (3,) near `up` (3,) in which the room's edges [view] (N, 2, 2) px are
    vertical; None if another direction fits nearly as many."""
    planes, weights = _span_planes(rig, edges, config)
    if len(planes) < 2:
        return None
    tried = _spread_directions(up, config)
    scores = (weights / (1 + (tried @ planes.T / config.width) ** 2) ** 2).sum(axis=1)
    best = tried[np.argmax(scores)]
    others = scores[tried @ best < np.cos(config.apart)]
    if scores.max() < config.distinct * others.max(initial=0):
        return None
    for _ in range(config.rounds):
        robust = weights / (1 + (planes @ best / config.width) ** 2) ** 2
        least = np.linalg.eigh((planes.T * robust) @ planes)[1][:, 0]
        best = least * np.sign(least @ best)
    return best


def _span_planes(
    rig: CameraRig, edges: Sequence[np.ndarray], config: VerticalConfig
) -> tuple[np.ndarray, np.ndarray]:
    """Return the unit normals (M, 3) of the planes through the edges and their cameras, and the
    edges' weights (M,): the angles they span, rad."""
    normals = [np.zeros((0, 3))]
    for camera, ends in zip(rig, edges, strict=True):
        rays = camera.rays(ends.reshape(-1, 2))
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        normals.append(np.cross(rays[::2], rays[1::2]))
    planes = np.concatenate(normals)
    planes = planes[np.isfinite(planes).all(axis=1)]  # beyond what the lens shows
    angles = np.linalg.norm(planes, axis=1)
    return planes / angles[:, None], np.minimum(angles, config.longest)


def _spread_directions(up: np.ndarray, config: VerticalConfig) -> np.ndarray:
    """Return directions (G, 3) around `up`."""
    steps = np.arange(-config.around, config.around + config.step, config.step)
    turns = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    turns = turns[np.linalg.norm(turns, axis=1) <= config.around]
    axes = np.linalg.svd(up[None])[2]
    tried = axes[0] * np.sign(axes[0] @ up) + np.tan(turns) @ axes[1:]
    return tried / np.linalg.norm(tried, axis=1, keepdims=True)
