"""What files of motion are written from: a body, its poses, and its points over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from apf.body.model import BodyModel
from apf.formats.trc import JointSeries


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """The motion of `body`.

    poses: (F, D) rad and m; in lost frames what the tracker held. lost: (F,) bool. points: joints
    and virtual markers over the same frames, NaN where lost. deviation: (F, P) m, the root mean
    square distance that the points may be away, NaN where unknown. note: where it comes from, for
    files that have room for a remark.
    """

    body: BodyModel
    poses: np.ndarray
    lost: np.ndarray
    points: JointSeries
    deviation: np.ndarray
    note: str = ""

    @property
    def times(self) -> np.ndarray:
        """(F,) s since the sequence's first frame."""
        return self.points.frames / self.points.fps

    def on_a_beat(self) -> tuple[float, np.ndarray]:
        """Return the rate, frames/s, of files that have no times, and for each of their frames the
        row of this motion, (N,): -1 where it has none, because a program that ran live left it out.
        """
        frames = self.points.frames
        if len(frames) < 2:
            return self.points.fps, np.arange(len(frames))
        step = int(np.gcd.reduce(np.diff(frames)))
        rows = np.full((frames[-1] - frames[0]) // step + 1, -1)
        rows[(frames - frames[0]) // step] = np.arange(len(frames))
        return self.points.fps / step, rows
