"""Faults of footage: what each kind tests, and on which evidence."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from psfs.cameras.camera import CameraRig
from psfs.common.numbers import FALSE_ALARMS
from psfs.diagnostics.agreement import HullAgreement
from psfs.diagnostics.small_views import SmallViews, mark_hidden_points
from psfs.diagnostics.tangency import Tangency
from psfs.footage.camera_times import CameraTimes
from psfs.sequence import Sequence

#: Longest offset of a camera in time, s; at most a third of the frames.
LONGEST_OFFSET = 2.0


@dataclass(frozen=True)
class Fault:
    """A fault of the footage.

    kind: a word for programs. cameras: names of the faulty cameras; empty if the fault concerns
    all. text: what was found, what was expected and what to do, in one line. offset: frames by
    which the camera comes late, if the kind is "late". serious: whether it is worth a warning, not
    only a note. spoils: whether the camera tells nothing about the person, so that it is left out.
    """

    kind: str
    cameras: tuple[str, ...]
    text: str
    offset: int = 0
    serious: bool = True
    spoils: bool = False

    def __str__(self) -> str:
        return self.text


class Evidence:
    """What the tests of faults measure in a sequence, each once.

    views: small pictures with silhouettes. known: the faults that were found before.
    """

    def __init__(self, sequence: Sequence, views: SmallViews) -> None:
        self.sequence, self.views = sequence, views
        self.rig: CameraRig = views.rig
        self.names = sequence.rig.names
        self.known: list[Fault] = []

    @property
    def sound(self) -> list[int]:
        """Numbers of the cameras whose pictures show something."""
        spoilt = {name for fault in self.known if fault.spoils for name in fault.cameras}
        return [view for view, name in enumerate(self.names) if name not in spoilt]

    def find_cause(self, cameras: Iterable[str]) -> Fault | None:
        """Return the first serious fault that names all of these cameras, if there is one."""
        serious = (fault for fault in self.known if fault.serious)
        return next((fault for fault in serious if set(cameras) <= set(fault.cameras)), None)

    def add(self, fault: Fault) -> None:
        """Add a fault. Cameras are named once: of two faults the one that spoils them stays, with
        the other's text as its cause."""
        cause = self.find_cause(fault.cameras) if fault.serious and fault.cameras else None
        if cause is not None:
            if not fault.spoils or cause.spoils:
                return
            fault = replace(fault, text=f"{fault.text}; {cause.text}", offset=cause.offset)
            self.known = [one for one in self.known if one.cameras != fault.cameras]
        self.known.append(fault)

    @cached_property
    def tangency(self) -> Tangency:
        """Differences between the cameras' extreme planes."""
        gone = set(range(len(self.names))) - set(self.sound)
        rows = [[None if v in gone else o for v, o in enumerate(r)] for r in self.views.outlines]
        return Tangency(self.rig, mark_hidden_points(rows, self.sequence.rig, self.rig))

    @cached_property
    def agreement(self) -> HullAgreement:
        """Agreement of the silhouettes with their common hull."""
        return HullAgreement(self.rig, self.views.silhouettes)

    @cached_property
    def times(self) -> CameraTimes:
        """When the cameras took their pictures, by the silhouettes."""
        most = min(round(LONGEST_OFFSET * self.sequence.fps), len(self.views.frames) // 3)
        return self.tangency.measure_times(most)

    @cached_property
    def offsets(self) -> np.ndarray:
        """Offsets (V,), whole frames, of the cameras that are late or early for certain: not by
        chance, and by more than a frame at two standard deviations, for a shorter lag may be one
        of exposure."""
        if not math.isfinite(self.tangency.size):
            return np.zeros(len(self.names), int)
        times = self.times
        sure = times.chances < FALSE_ALARMS
        sure &= np.abs(times.offsets) - 2 * times.sigmas > 1
        return np.where(sure, times.whole, 0)


def significant(samples: np.ndarray, least: float, tests: int = 1) -> bool:
    """Return whether the mean of samples (N,) of stretches of the take is above `least`: a t test
    with a probability of `FALSE_ALARMS` for a false alarm in so many tests."""
    known = samples[np.isfinite(samples)]
    if len(known) < 2:
        return False
    deviation = max(float(known.std(ddof=1)), 1e-9) / np.sqrt(len(known))
    chance = scipy.special.stdtr(len(known) - 1, (least - known.mean()) / deviation)
    return bool(chance < FALSE_ALARMS / tests)
