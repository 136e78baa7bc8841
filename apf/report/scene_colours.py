"""The colours of a track on every page: those of studio and view, and the report."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from apf.body.model import find_side
from apf.report.overlay import COLOURS
from apf.tracking.track import Track

#: RGB of a side of the body: blue, orange and green; and of what is lost. People who are
#: colour-blind distinguish them.
SIDES = {side: (int(r), int(g), int(b)) for side, (b, g, r) in COLOURS.items()}
LOST = (120, 0, 80)


def colour_by_side(names: Iterable[str]) -> np.ndarray:
    """Return the colours (N, 3) uint8 of the sides that cones or joints, by name, are on."""
    return np.array([SIDES[find_side(name)] for name in names], np.uint8).reshape(-1, 3)


def colour_edges(track: Track) -> np.ndarray:
    """Return the colours (E, 3) uint8 of a track's edges: the sides of the joints they lead to."""
    return colour_by_side(track.joint_names[end] for _, end in track.edges)
