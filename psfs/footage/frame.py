"""One frame of all views: pictures or masks, and where the person may be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

#: Returns (N,) bool: which of points (N, 3) m may be the person's.
Space: TypeAlias = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Frame:
    """The pictures or masks of all views at one time. Views smaller than the rig's width and height
    are zero padded.

    images: (V, H, W, 3) uint8 BGR, or None if there are only masks. masks: (V, H, W) uint8, 255 =
    person, or None if silhouettes are computed with a `Background`. space: where the person may be,
    None for everywhere.
    """

    index: int
    images: np.ndarray | None
    masks: np.ndarray | None
    space: Space | None = None
