"""Where cameras see the person, and how large."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from psfs.cameras.camera import Camera
from psfs.cameras.triangulation import intersect_rays
from psfs.diagnostics.hulls import HullRays


@dataclass(frozen=True, eq=False)
class Sight:
    """The person in one camera: the usual direction (3,) of the middle in the camera's axes, and
    the usual angle, rad, between top and bottom; NaN if the camera never shows both ends."""

    direction: np.ndarray
    size: float

    @property
    def known(self) -> bool:
        """Whether the camera shows the person."""
        return bool(np.isfinite(self.direction).all() and np.isfinite(self.size))

    @classmethod
    def create(cls, hulls: HullRays) -> Sight:
        pixel = hulls.rays[:, :2]
        low, high = hulls.extremes(pixel[:, 1]).T
        left, right = hulls.extremes(pixel[:, 0]).T
        known = np.isfinite(low + high) & np.isfinite(left + right)
        if not known.any():
            return cls(np.full(3, np.nan), float("nan"))
        middle = np.array([np.median((left + right)[known]), np.median((low + high)[known]), 2.0])
        size = np.median((np.arctan(high) - np.arctan(low))[known])
        return cls(middle / np.linalg.norm(middle), float(size))


@dataclass(frozen=True, eq=False)
class PersonPlace:
    """The person in a rig's world: middle (3,), up (3,) and stature, in the rig's units."""

    middle: np.ndarray
    up: np.ndarray
    stature: float


def find_person(cameras: Sequence[Camera], sights: Sequence[Sight]) -> PersonPlace:
    """Return the person between the cameras: where their directions meet. Up is Z, turned to be
    across the cameras' right sides. NaN if fewer than two cameras show the person wholly."""
    pairs = [pair for pair in zip(cameras, sights, strict=False) if pair[1].known]
    if len(pairs) < 2:
        return PersonPlace(np.full(3, np.nan), np.array([0.0, 0, 1]), float("nan"))
    rays = np.stack([camera.R.T @ sight.direction for camera, sight in pairs])
    centres = np.stack([camera.centre for camera, _ in pairs])
    middle = intersect_rays(centres, rays)
    right = np.stack([camera.R[0] for camera, _ in pairs])
    roll = right.T @ right / 0.05**2 + np.diag([1, 1, 0]) / 0.1**2
    up = np.linalg.eigh(roll)[1][:, 0]
    up = up if up[2] > 0 else -up
    away = centres - middle
    sizes = np.linalg.norm(away, axis=1) * [sight.size for _, sight in pairs]
    return PersonPlace(middle, up, float(np.median(sizes)))
