"""Pixels where furniture hides what is behind it: they can confirm a person but not deny one."""

from __future__ import annotations

import numpy as np

from cl import Array, Device, Launch
from psfs.background.config import UNKNOWN as UNKNOWN

#: Value of the masks of one of several people that says nothing.
UNKNOWN_MASK = 128
#: Pixels per work-item.
_LOT = 16


def hide_launch(device: Device, hidden: np.ndarray, evidence: Array) -> Launch:
    """Return the launch that sets the evidence (V, H, W) int8 to `UNKNOWN` at hidden (V, H, W) bool
    pixels where it is not above 0: a person before the furniture stays visible.

    Kernel: hidden.cl; twin: `psfs.reference.hidden.hide`.
    """
    kernel = device.kernel("reconstruction/hidden", "hide", LOT=_LOT, UNKNOWN=UNKNOWN)
    where = device.to_device(hidden.view(np.uint8), "the hidden pixels")
    return device.launch(
        kernel, (_lots(hidden.size),), (64,), n_pixels=hidden.size, hidden=where, evidence=evidence
    )


def mark_hidden_launch(device: Device, evidence: Array, maps: Array) -> Launch:
    """Return the launch that flips the lowest bit of the silhouettes, the first channel of maps (V,
    H, W, 2) uint8, where the evidence (V, H, W) int8 is `UNKNOWN`.

    255 becomes 254 and 0 becomes 1: these differ little as silhouettes, and show terms that read
    the pictures, too, that something else is visible there. Twin:
    `psfs.reference.hidden.mark_hidden`.
    """
    kernel = device.kernel("reconstruction/hidden", "mark_hidden", LOT=_LOT, UNKNOWN=UNKNOWN)
    return device.launch(
        kernel, (_lots(evidence.size),), (64,), n_pixels=evidence.size, evidence=evidence, maps=maps
    )


def _lots(n_pixels: int) -> int:
    return -(-n_pixels // _LOT)
