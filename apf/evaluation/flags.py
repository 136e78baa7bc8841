"""What a track says of its own limbs, beside the truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from apf.body.limbs import limb_joints, limb_names
from apf.evaluation.joint_names import match_joints
from apf.formats.trc import JointSeries
from apf.tracking.track import Track


class FlagCounts(NamedTuple):
    """Limb-frames beyond 200 mm that are said to be lost, and all beyond it; within 150 mm that are
    said to be lost, and all within it."""

    far_flagged: int
    far: int
    near_flagged: int
    near: int

    @property
    def found(self) -> float:
        """Share of those far that are flagged; NaN without any."""
        return self.far_flagged / self.far if self.far else float("nan")

    @property
    def falsely(self) -> float:
        """Share of those near that are flagged; NaN without any."""
        return self.near_flagged / self.near if self.near else float("nan")


def flagged_joints(track: Track | JointSeries, names: tuple[str, ...]) -> np.ndarray:
    """(F, J) bool, which of the joints of these names are of limbs that the track says to be lost;
    other points are of none."""
    found = np.zeros((len(track.frames), len(names)), bool)
    if isinstance(track, Track) and track.body is not None:
        columns, gone = match_joints(track.joint_names), track.lost_limbs @ limb_joints(track.body)
        for j, name in enumerate(names):
            if name in columns:
                found[:, j] = gone[:, columns[name]]
    return found


def said_lost(track: Track | JointSeries, rows: np.ndarray) -> dict[str, float]:
    """The share of rows in which the track says that a limb is lost, by limb; those never lost are
    left out."""
    if not isinstance(track, Track) or track.body is None:
        return {}
    shares = track.lost_limbs[rows].mean(axis=0)
    found = dict(zip(limb_names(track.body), shares.tolist(), strict=True))
    return {name: share for name, share in found.items() if share}
