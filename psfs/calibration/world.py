"""The world's axes: Z up from the floor, on which the target lay, or from the cameras."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cl import InputError
from psfs.calibration.scene import Scene, moved, rigid
from psfs.calibration.targets.target import Target

#: Deviation of the target's points from the floor that they lie on, m, at most; and how far they
#: must reach across its longest side, as a share of that.
_FLAT, _BROAD = 0.03, 0.05


def on_floor(scene: Scene, target: Target, frames: Sequence[int], height: float) -> np.ndarray:
    """Return the motion (4, 4) to the world whose floor is Z = 0, from where the target lay in
    these frames; its points are `height` m above the floor. The first point seen is above the
    origin, the target's X axis gives that of the world. Raises InputError unless they make a
    plane."""
    seen = [frame for frame in frames if frame in scene.poses]
    if not seen:
        raise InputError(
            f"the floor: the {target.name} is not seen, by enough cameras, in the frames stated; "
            f"expected frames in which it lies on the floor"
        )
    points = np.concatenate([scene.points(target, frame) for frame in seen])
    middle = points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(points - middle, full_matrices=False)
    if len(points) < 3 or sizes[1] < _BROAD * sizes[0]:
        raise InputError(
            f"the floor: the {target.name} lies along one line in the frames stated; expected "
            "frames in which it lies on the floor in two directions"
        )
    off = float(np.abs((points - middle) @ axes[2]).max())
    if off > _FLAT:
        raise InputError(
            f"the floor: the points of the {target.name} lie {1000 * off:.0f} mm off a plane in "
            f"the frames stated; expected at most {1000 * _FLAT:.0f}"
        )
    first = scene.points(target, seen[0])
    across = first[-1] - first[0] if not target.planar else scene.poses[seen[0]][:3, 0]
    return _world(scene, axes[2], across, first[0], height)


def by_cameras(scene: Scene, target: Target) -> np.ndarray:
    """Return the motion (4, 4) to a world whose Z axis is the cameras' mean up, whose floor is
    where the target's lowest point was, and whose origin is below the middle of its points."""
    up = -np.mean([camera.R[1] for camera in scene.cameras], axis=0)
    if np.linalg.norm(up) < 0.1:  # cameras that look down from above
        up = np.mean([camera.centre for camera in scene.cameras], axis=0)
    up = up / np.linalg.norm(up)
    points = np.concatenate([scene.points(target, frame) for frame in scene.poses])
    middle = points.mean(axis=0)
    lowest = middle + ((points - middle) @ up).min() * up
    first = scene.cameras[0]
    return _world(scene, up, first.R[0], lowest, 0.0, towards_cameras=False)


def _world(
    scene: Scene,
    normal: np.ndarray,
    across: np.ndarray,
    origin: np.ndarray,
    height: float,
    towards_cameras: bool = True,
) -> np.ndarray:
    """Return the motion (4, 4) to the axes with Z along `normal`, on the cameras' side of the
    floor, X along `across`, and the `origin` at (0, 0, height)."""
    z = normal / np.linalg.norm(normal)
    centres = np.array([camera.centre for camera in scene.cameras])
    if towards_cameras and ((centres - origin) @ z).mean() < 0:
        z = -z
    x = across - (across @ z) * z
    x = x / np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z])
    return rigid(R, np.array([0, 0, height]) - moved(rigid(R, np.zeros(3)), origin))
