"""Outlines of bodies of cones, seen by four cameras."""

import numpy as np

from apf.initialisation.personal import Outlines, find_outline_pixels, find_outlines
from helpers import scenes
from psfs.cameras.camera import CameraRig
from psfs.common.cones import ray_cone_distances

RIG = scenes.ring(4, (240, 320))


def masks(rig: CameraRig, cones: np.ndarray) -> np.ndarray:
    """Return exact silhouettes (V, H, W) of cones (C, 16)."""
    shown = np.zeros((len(rig), rig.height, rig.width), bool)
    for camera, mask in zip(rig, shown, strict=True):
        ends = camera.project(np.concatenate([cones[:, 0:3], cones[:, 4:7]]))[0].astype(int)
        (left, top), (right, bottom) = np.maximum(ends.min(0) - 25, 0), ends.max(0) + 25
        y, x = np.nonzero(np.ones_like(mask[top:bottom, left:right]))
        rays = camera.rays(np.stack([x + left, y + top], -1).astype(float))
        mask[y + top, x + left] = ray_cone_distances(camera.centre, rays, cones).min(1) < 0
    return shown


def outlines_of(cones: np.ndarray) -> Outlines:
    shown = masks(RIG, cones)
    return outlines_in(shown, np.ones_like(shown))


def outlines_in(shown: np.ndarray, known: np.ndarray) -> Outlines:
    return find_outlines(RIG, [find_outline_pixels(shown, known)])[0]
