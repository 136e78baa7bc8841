"""Pixels where furniture hides what is behind it: they can confirm a person but not deny one."""

from __future__ import annotations

import numpy as np

from cl import Array, Device, Launch
from psfs.background.config import UNKNOWN as UNKNOWN
from psfs.common.edge_distance import LOT

#: Counts that `UNKNOWN` evidence adds to a voxel: the least there are. Two cameras that show a
#: person outweigh those from which the place is hidden, one alone does not.
HIDDEN = -1


def hide_launch(device: Device, hidden: np.ndarray, evidence: Array) -> Launch:
    """Return the launch that sets the evidence (V, H, W) int8 to `UNKNOWN` at hidden (V, H, W) bool
    pixels where it is not above 0: a person before the furniture stays visible.

    Kernel: hidden.cl; twin: `psfs.reference.reprojection.hide`.
    """
    kernel = device.kernel("reconstruction/hidden", "hide", LOT=LOT, UNKNOWN=UNKNOWN)
    where = device.to_device(hidden.view(np.uint8), "the hidden pixels")
    return device.launch(
        kernel, (-(-hidden.size // LOT),), (64,), n_pixels=hidden.size, hidden=where,
        evidence=evidence,
    )  # fmt: skip
