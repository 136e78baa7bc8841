"""How many pixels a voxel covers."""

from __future__ import annotations

import numpy as np

from psfs.camera import CameraRig


def footprints(rig: CameraRig, voxel_size: float) -> np.ndarray:
    """(V, 2) half width and height of a projected voxel's bounding box times its depth, px m.

    A cube of edge s turned by R spans s times the sum of a row of |R| along a camera axis; so no
    hole opens between neighbouring voxels, however the camera is turned.
    """
    spans = [np.abs(camera.R[:2]).sum(1) * np.diag(camera.K)[:2] for camera in rig]
    return 0.5 * voxel_size * np.array(spans)
