"""Resize pictures by exactly the factor of `Camera.scaled`."""

from __future__ import annotations

import cv2
import numpy as np

from psfs.cameras.camera import CameraRig


def scale_picture(picture: np.ndarray, factor: float, out: np.ndarray | None = None) -> np.ndarray:
    """Return a picture (H, W, ...) resized by `factor`, at most 1: the mean over each pixel's area,
    as the camera `scaled(factor)` shows it. out: filled and returned, if it is of that size.

    The small sides are rounded, the scale is not: stated sizes would make cv2.resize stretch it.
    """
    return cv2.resize(picture, None, out, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)


def scale_pictures(
    pictures: np.ndarray, rig: CameraRig, small: CameraRig, factor: float
) -> np.ndarray:
    """Return pictures (V, h, w, ...) of pictures (V, H, W, ...) of a rig, as `small`, which is the
    rig `scaled(factor)`, shows them; zeros beside those that are smaller than others."""
    out = np.empty((len(rig), small.height, small.width, *pictures.shape[3:]), pictures.dtype)
    for view, (before, after) in enumerate(zip(rig, small, strict=True)):
        picture = pictures[view, : before.size[1], : before.size[0]]
        if after.size == (small.width, small.height):  # written in place
            scale_picture(picture, factor, out[view])
            continue
        out[view] = 0
        out[view, : after.size[1], : after.size[0]] = scale_picture(picture, factor)
    return out
