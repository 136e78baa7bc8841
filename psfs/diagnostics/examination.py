"""Examination of the footage before work: its faults, the cameras to leave out, and clocks that run
differently."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from cl import InputError
from psfs.common.numbers import FALSE_ALARMS
from psfs.diagnostics.alignment import correct_rig
from psfs.diagnostics.fault import LONGEST_OFFSET, Fault
from psfs.diagnostics.faults import Diagnosis, diagnose
from psfs.diagnostics.occluders import find_hidden_pixels
from psfs.diagnostics.small_views import small_views
from psfs.diagnostics.tangency import Tangency
from psfs.footage.camera_times import MOST_DRIFT
from psfs.footage.settings import split_delays
from psfs.sequence import Sequence
from psfs.session import Session
from psfs.volume import find_volume

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Examination:
    """The result of `examine`.

    session: the session to work in, without the cameras that were left out, with late cameras
    shifted and the rig corrected. diagnosis: the footage's faults; None if it was not examined.
    left_out: the faults of the cameras that were left out, one each.
    """

    session: Session
    diagnosis: Diagnosis | None = None
    left_out: tuple[Fault, ...] = ()

    @property
    def faults(self) -> list[Fault]:
        """The faults of the footage, the most serious first."""
        return [] if self.diagnosis is None else self.diagnosis.faults

    @property
    def of_all(self) -> Fault | None:
        """The first fault that leaving out one camera cannot mend; None without any."""
        return None if self.diagnosis is None else self.diagnosis.of_all

    def check_sight(self) -> None:
        """Raise InputError if the pictures of all cameras but one, or of all, show nothing."""
        blind = () if self.diagnosis is None else self.diagnosis.blind
        n_cameras = 0 if self.diagnosis is None else len(self.diagnosis.views.rig)
        if blind and len(blind) + 1 >= n_cameras:
            raise InputError(
                f"{self.session.sequence.name}: {len(blind)} of {n_cameras} cameras show nothing "
                f"of a person, expected two or more that do; {blind[0]}"
            )

    @property
    def warnings(self) -> list[str]:
        """The cameras left out and the other serious faults, one line each."""
        return [*(f"left out: {fault}" for fault in self.left_out), *self.remaining]

    @property
    def remaining(self) -> list[str]:
        """The serious faults other than those of cameras that were left out."""
        gone = {name for fault in self.left_out for name in fault.cameras}
        return [str(f) for f in self.faults if f.serious and not gone & set(f.cameras)]


def examine(session: Session, all_cameras: bool = False) -> Examination:
    """Diagnose the footage, shift late cameras, correct the rig and leave out faulty cameras.

    Late cameras are shifted if the sequence's `sync` is "auto". Cameras that show nothing or
    disagree with the others are left out, unless `all_cameras` is true, the sequence was opened
    with `cameras`, or the fault is not that of a single camera. The rig gets the pixels where
    furniture hides people (see `find_hidden_pixels`), and its cameras are turned if they are off
    (see `correct_rig`).
    """
    session = synchronise(session)
    diagnosis = diagnose(session)
    if diagnosis.of_all is not None:
        return Examination(session, diagnosis)
    left_out = diagnosis.left_out
    if all_cameras or session.sequence.settings.cameras is not None:
        left_out = ()
    gone = {name for fault in left_out for name in fault.cameras}
    if gone:
        kept = [name for name in session.rig.names if name not in gone]
        session = session.with_sequence(session.sequence.with_cameras(kept))
    return Examination(_correct_rig(session, diagnosis), diagnosis, left_out)


def _correct_rig(session: Session, diagnosis: Diagnosis) -> Session:
    """Return a session whose rig has the pixels hidden by furniture and corrected directions."""
    hidden = find_hidden_pixels(session)
    if hidden is not None:
        volume = find_volume(session)
        session = session.with_sequence(session.sequence.with_rig(session.rig.with_hidden(hidden)))
        session.replace_result(find_volume, volume)
    found = correct_rig(session, diagnosis.views)
    if found is None:
        return session
    log.info("%s: %s", session.sequence.name, found)
    return session.with_sequence(session.sequence.with_rig(found.rig))


def synchronise(session: Session) -> Session:
    """Return the session or, if `sync` is "auto", one whose late cameras are shifted, and whose
    cameras are followed where their clocks run differently."""
    if session.sequence.settings.sync != "auto":
        return session
    found = diagnose(session)
    if found.of_all is not None:
        return session.with_sequence(session.sequence.synchronise(found.late))
    return session.with_sequence(follow_clocks(session, found.late, len(found.views.frames)))


def follow_clocks(session: Session, late: Mapping[str, int], n_frames: int) -> Sequence:
    """Return the session's sequence with late cameras shifted, and clocks followed that run
    differently.

    late: frames by which cameras come later in the middle, by name. n_frames: of a stretch in which
    offsets are measured. These are measured on both sides of the middle: first so near it that no
    clock leads beyond the offsets that are tried, then at the ends. A clock differs if chance would
    make it with a probability of at most `FALSE_ALARMS`, and if some frame is then half
    a frame off.
    """
    sequence = session.sequence.synchronise(late)
    n_frames = min(n_frames, len(sequence) // 2)
    most = min(round(LONGEST_OFFSET * sequence.fps), n_frames // 3)
    if most < 2:
        return sequence
    leader: int | None = None
    for reach in (most / (2 * MOST_DRIFT), np.inf):
        away = int(min(reach, (len(sequence) - n_frames) // 2))
        starts = [(len(sequence) - n_frames) // 2 + side * away for side in (-1, 1)]
        (first, before), (last, after) = (
            _measure_clocks(session, sequence, range(start, start + n_frames), most)
            for start in starts
        )
        passed = last - first
        if leader is None:
            leader = int(passed.argsort()[(len(passed) - 1) // 2])
        speeds = passed / passed[leader]
        sigmas = np.hypot(before, after)
        limit = scipy.special.ndtri(1 - FALSE_ALARMS / 2) / passed[leader]
        differs = np.abs(speeds - 1) > limit * np.hypot(sigmas, sigmas[leader])
        differs &= np.abs(speeds - 1) * len(sequence) > 0.5
        delays = dict.fromkeys(sequence.rig.names, (0.0, 1.0))
        delays |= split_delays(sequence.settings.sync)
        rates = sequence.timing.rates
        time = first[leader] - delays[sequence.rig.names[leader]][0] / rates[leader]
        for view in np.flatnonzero(differs):
            lag = float(first[view] - speeds[view] * time) * rates[view]
            delays[sequence.rig.names[view]] = lag, float(speeds[view])
        sequence = sequence.with_delays(delays)
        if away < reach:
            break
    return sequence


def _measure_clocks(
    session: Session, sequence: Sequence, frames: range, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return what each camera's clock shows at one time, in the middle of `frames` (V,), s, and the
    standard deviations (V,): infinite where the silhouettes do not tell."""
    views = small_views(sequence, session.device, frames=frames)
    times = Tangency(views.rig, views.outlines).measure_times(most)
    middle = frames[len(frames) // 2]
    clocks = np.array([clock[middle] for clock in sequence.timing.clocks])
    unsure = (np.array(times.whole) != 0) & (times.chances >= FALSE_ALARMS)
    sigmas = np.where(unsure, np.inf, times.sigmas)
    return clocks + times.offsets / sequence.fps, sigmas / sequence.fps
