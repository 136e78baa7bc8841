"""One frame of all views: pictures or masks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Frame:
    """The pictures or masks of all views at one time. Views smaller than the rig's width and height
    are zero padded.

    images: (V, H, W, 3) uint8 BGR, or None if there are only masks. masks: (V, H, W) uint8, 255 =
    person, or None if silhouettes are computed with a `Background`.
    """

    index: int
    images: np.ndarray | None
    masks: np.ndarray | None
