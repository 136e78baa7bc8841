"""Where a rig looks: the point where the optical axes meet and the box that cameras share."""

from __future__ import annotations

import numpy as np

from psfs.cameras.camera import CameraRig

#: Points along a side of the lattices; odd, so that the centre is one of them.
_COARSE, _FINE = 21, 41


def axes_meet(rig: CameraRig) -> np.ndarray:
    """(3,) m: the point with the least sum of squared distances to the optical axes.

    Solves sum_v (I - d d^T) (x - c) = 0, d the viewing direction, c the centre of camera v; for
    one camera, or parallel ones, the least-norm correction to the mean camera centre.
    """
    middle = rig.centres.mean(axis=0)
    A, b = np.zeros((3, 3)), np.zeros(3)
    for camera in rig:
        direction = camera.R[2]
        across = np.eye(3) - np.outer(direction, direction)
        A += across
        b += across @ (camera.centre - middle)
    return middle + np.linalg.lstsq(A, b, rcond=1e-6)[0]


def views_needed(rig: CameraRig) -> int:
    """How many cameras must see a place for it to be worth reconstructing: three quarters."""
    return max(1, -(-3 * len(rig) // 4))


def seen_points(rig: CameraRig, needed: int) -> np.ndarray:
    """(N, 3) m: points of a coarse regular lattice that `needed` cameras see.

    The lattice is centred where the axes meet and reaches as far as the farthest camera.
    """
    centre = axes_meet(rig)
    reach = max(np.linalg.norm(rig.centres - centre, axis=1).max(), 1e-9)
    return _seen(rig, _lattice(centre - reach, centre + reach, _COARSE), needed)


def seen_box(rig: CameraRig, needed: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Low and high corner (3,) m of what `needed` cameras see, or None if there is nothing."""
    points = seen_points(rig, needed)
    if not len(points):
        return None
    step = 2 * np.linalg.norm(rig.centres - axes_meet(rig), axis=1).max() / (_COARSE - 1)
    finer = _lattice(points.min(axis=0) - step, points.max(axis=0) + step, _FINE)
    points = np.concatenate([points, _seen(rig, finer, needed)])
    return points.min(axis=0), points.max(axis=0)


def _lattice(low: np.ndarray, high: np.ndarray, steps: int) -> np.ndarray:
    axes = [np.linspace(a, b, steps) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def _seen(rig: CameraRig, points: np.ndarray, needed: int) -> np.ndarray:
    views = np.sum([camera.look_up(points)[0] for camera in rig], axis=0)
    return points[views >= needed]
