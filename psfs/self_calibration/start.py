"""Cameras placed by an arrangement of the search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.self_calibration.upright import UprightView


def place_cameras(
    cameras: Sequence[Camera], views: Sequence[UprightView], angles: np.ndarray,
    lags: Sequence[int], stature: float,
) -> CameraRig:  # fmt: skip
    """Place cameras by their upright views, angles (V,) rad and lags, in the views' frames.

    The first camera is above the origin, Z is its up; the stature, m, gives the scale.
    """
    placed, first = [], views[0].places
    for camera, view, angle, lag in zip(cameras, views, angles, lags, strict=True):
        cosine, sine = np.cos(angle), np.sin(angle)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        begin, end = max(0, -lag), max(0, -lag, min(len(first), len(view.places) - lag))
        apart = first[begin:end] - view.places[begin + lag : end + lag] @ turn.T
        known = np.isfinite(apart).all(axis=1)
        shift = apart[known].mean(axis=0) if known.any() else np.zeros(2)
        world = np.eye(3)
        world[:2, :2] = turn
        R = view.axes.T @ world.T
        placed.append(replace(camera, R=R, t=-R @ (stature * np.array([*shift, view.height]))))
    return CameraRig(tuple(placed))
