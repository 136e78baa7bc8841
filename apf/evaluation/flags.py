"""Comparison of the limbs that a track reports as lost with the truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from apf.body.limbs import limb_joints, limb_names
from apf.evaluation.joint_names import match_joints
from apf.formats.trc import JointSeries
from apf.tracking.track import Track


class FlagCounts(NamedTuple):
    """Numbers of limb-frames: reported as lost and all, of those with an error above 200 mm;
    reported as lost and all, of those with an error below 150 mm."""

    far_flagged: int
    far: int
    near_flagged: int
    near: int

    @property
    def found(self) -> float:
        """Share of the wrong limb-frames that are reported; NaN if there are none."""
        return self.far_flagged / self.far if self.far else float("nan")

    @property
    def falsely(self) -> float:
        """Share of the right limb-frames that are reported; NaN if there are none."""
        return self.near_flagged / self.near if self.near else float("nan")


def flagged_joints(track: Track | JointSeries, names: tuple[str, ...]) -> np.ndarray:
    """Return (F, J) bool: which joints belong to limbs that the track reports as lost. Points that
    are no joints of the track belong to none."""
    found = np.zeros((len(track.frames), len(names)), bool)
    if isinstance(track, Track) and track.body is not None:
        columns, gone = match_joints(track.joint_names), track.lost_limbs @ limb_joints(track.body)
        for j, name in enumerate(names):
            if name in columns:
                found[:, j] = gone[:, columns[name]]
    return found


def compute_lost_fractions(track: Track | JointSeries, rows: np.ndarray) -> dict[str, float]:
    """Return the share of `rows` in which the track reports a limb as lost, by limb; limbs that are
    never lost are left out."""
    if not isinstance(track, Track) or track.body is None:
        return {}
    shares = track.lost_limbs[rows].mean(axis=0)
    found = dict(zip(limb_names(track.body), shares.tolist(), strict=True))
    return {name: share for name, share in found.items() if share}
