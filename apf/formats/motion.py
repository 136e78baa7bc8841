"""The motion that files are written from: a body, its poses, and its points over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from apf.body.model import BodyModel
from apf.formats.trc import JointSeries


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """The motion of `body`.

    poses: (F, D) rad and m; in lost frames the tracker's last estimate, lost limbs interpolated.
    lost: (F,) bool. lost_limbs: (F, L) bool, of `limb_names`. points: joints and virtual markers
    over the same frames, NaN where lost.
    """

    body: BodyModel
    poses: np.ndarray
    lost: np.ndarray
    lost_limbs: np.ndarray
    points: JointSeries


def interpolate_gaps(values: np.ndarray, times: np.ndarray, gone: np.ndarray) -> np.ndarray:
    """Interpolate values (F, N) at `times` (F,) linearly where `gone` (F, N) bool.

    Columns that are gone throughout stay as they are.
    """
    out = np.array(values)
    for column in np.flatnonzero(gone.any(0) & ~gone.all(0)):
        lost = gone[:, column]
        out[lost, column] = np.interp(times[lost], times[~lost], values[~lost, column])
    return out
