"""Lens distortion that a calibration does not state, found by the silhouettes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.common.numbers import pick_evenly
from psfs.diagnostics.config import FaultConfig
from psfs.diagnostics.small_views import Outline
from psfs.diagnostics.tangency import Tangency

#: Radial distortions k1 of wide lenses that are tried, and errors of the focal length that would
#: look alike.
_DISTORTIONS = (-0.1, -0.2, -0.3, -0.4)
_FOCAL_FACTORS = (0.85, 0.9, 0.95, 1.05, 1.1)
#: By how much less, as a share of the present cost, the cost must be with a distortion than with
#: another focal length.
_CLEARER = 0.05
#: Least number of frames: the single frame of `dancer8` fits better with k1 = -0.2. Most frames and
#: cameras that are compared.
_LEAST_FRAMES, _MOST_FRAMES, _MOST_CAMERAS = 20, 30, 8


def find_dropped_distortion(
    rig: CameraRig, outlines: Sequence[Sequence[Outline | None]], config: FaultConfig
) -> tuple[list[int], float] | None:
    """Return the cameras whose distortion the calibration lacks, all or one, and the k1 with which
    their silhouettes fit; None if they fit as well without.

    If no camera has a distortion, that of a wide lens is tried for all at once, and other focal
    lengths, which move silhouettes alike. If only some cameras have none, the median of the others'
    is tried for each.
    """
    if len(outlines) < _LEAST_FRAMES:
        return None
    frames = pick_evenly(len(outlines), _MOST_FRAMES)
    rows = [list(outlines[frame]) for frame in frames]
    plain = [view for view, camera in enumerate(rig) if not camera.lens.any()]
    if len(plain) == len(rig):
        k1 = _fit_all(rig, rows, config)
        return None if k1 is None else (list(range(len(rig))), k1)
    if 2 * len(plain) >= len(rig):
        return None
    usual = np.median([camera.distortion for camera in rig if camera.lens.any()], axis=0)
    present = Tangency(rig, rows).compare().cameras if plain else np.zeros(0)
    for view in plain:
        cameras = [replace(c, distortion=usual) if v == view else c for v, c in enumerate(rig)]
        cost = Tangency(CameraRig(tuple(cameras)), rows).compare().cameras[view]
        if cost < config.lens_share * present[view]:
            return [view], float(usual[0])
    return None


def _fit_all(rig: CameraRig, rows: list[list[Outline | None]], config: FaultConfig) -> float | None:
    """Return the k1 with which the outlines of all cameras fit best, if they fit much better."""
    views = pick_evenly(len(rig), _MOST_CAMERAS)
    outlines = [[row[view] for view in views] for row in rows]

    def measure(k1: float = 0.0, factor: float = 1.0) -> float:
        cameras = tuple(_with_lens(rig[view], k1, factor) for view in views)
        return Tangency(CameraRig(cameras), outlines).compare().cost

    present = measure()
    costs = {k1: measure(k1) for k1 in _DISTORTIONS}
    best = min(costs, key=lambda k1: costs[k1])
    if not costs[best] < config.lens_share * present:
        return None
    focal = min(measure(factor=factor) for factor in _FOCAL_FACTORS)
    return best if costs[best] < focal - _CLEARER * present else None


def _with_lens(camera: Camera, k1: float, factor: float) -> Camera:
    K = camera.K.copy()
    K[[0, 0, 1], [0, 1, 1]] *= factor
    return replace(camera, K=K, distortion=np.array([k1, 0, 0, 0, 0]))
