"""Find cameras whose recording hangs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from psfs.diagnostics.fault import Fault
from psfs.diagnostics.picture_config import PictureConfig
from psfs.diagnostics.small_views import SmallViews
from psfs.sequence import Sequence


def find_frozen_cameras(
    sequence: Sequence, views: SmallViews, config: PictureConfig
) -> Iterator[Fault]:
    """Find cameras in which the person stops moving, for all frames or for some, though he moves in
    the others."""
    areas = np.array(
        [[outline.area if outline else 0 for outline in row] for row in views.outlines]
    )
    if len(areas) < 4 or areas.shape[1] < 2:
        return
    for view, name in enumerate(sequence.rig.names):
        rows = _longest_hang(areas[:, view], config)
        if rows.stop - rows.start < len(areas) and rows.stop - rows.start < config.hung:
            continue
        others = np.delete(areas[rows], view, axis=1)
        changes = np.ptp(others, axis=0) / np.maximum(np.median(others, axis=0), 1)
        if not np.median(changes) > config.moving:
            continue
        where = "all frames"
        if rows.stop - rows.start < len(areas):
            first = views.frames[rows.start]
            where = f"frames {first} to {views.frames[rows.stop - 1]}"
        yield Fault(
            "frozen",
            (name,),
            f"camera {name} shows the same picture in {where}, in which the others show motion; "
            "its recording hangs: leave it out (--cameras)",
        )


def _longest_hang(areas: np.ndarray, config: PictureConfig) -> slice:
    """Return the longest run of frames in which a silhouette keeps its area (F,), px.

    All frames if it hardly changes; else those of the very same area, but for one in three, since
    each key frame of a video changes a frozen silhouette once.
    """
    middle = np.median(areas)
    if middle and np.ptp(areas) < config.frozen * middle:
        return slice(0, len(areas))
    same = np.flatnonzero(np.diff(areas) == 0)
    best, start, count = slice(0, 0), 0, 0
    for number, step in enumerate(same.tolist()):
        if number == 0 or step - same[number - 1] > 3:
            start, count = step, 0
        count += 1
        if 3 * count >= 2 * (step + 1 - start) and step + 2 - start > best.stop - best.start:
            best = slice(start, step + 2)
    return best if middle else slice(0, 0)
