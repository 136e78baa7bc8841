"""The stages `diagnose`, which finds faults of the footage before hours are spent on it, and
`examine`, which leaves cameras out and follows clocks that run differently."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from cl import InputError
from psfs.common.numbers import FALSE_ALARMS
from psfs.diagnostics.alignment import correct_rig
from psfs.diagnostics.arrangement_faults import find_disagreeing, find_late, find_rearranged
from psfs.diagnostics.calibration_faults import find_wrong_calibration, find_wrong_unit
from psfs.diagnostics.fault import LONGEST_OFFSET, Evidence, Fault
from psfs.diagnostics.occluders import find_hidden_pixels
from psfs.diagnostics.picture_faults import (
    find_cut,
    find_empty,
    find_flicker,
    find_repeated,
    find_wrong_background,
)
from psfs.diagnostics.small_views import SmallViews, small_views
from psfs.diagnostics.tangency import Tangency
from psfs.footage.camera_times import MOST_DRIFT
from psfs.footage.settings import split_delays
from psfs.sequence import Sequence
from psfs.session import Session

#: The tests of all kinds, in their order: later ones leave out the cameras whose pictures earlier
#: ones found to show nothing. Each accuses footage without its fault with a probability of at most
#: `FALSE_ALARMS`.
TESTS: tuple[Callable[[Evidence], Iterator[Fault]], ...] = (
    *(find_wrong_calibration, find_empty, find_repeated, find_wrong_background, find_flicker),
    *(find_rearranged, find_late, find_disagreeing, find_wrong_unit, find_cut),
)
_COMPARING = (find_rearranged, find_late, find_disagreeing)
#: Faults that invalidate those of single cameras, and faults that leaving out cannot mend.
_REARRANGED = ("exchange", "flipped", "convention")
_OF_ALL = (*_REARRANGED, "unit")


@dataclass(frozen=True)
class Diagnosis:
    """The faults of a sequence, the most serious first, and the small pictures that were
    examined."""

    faults: list[Fault]
    views: SmallViews

    @property
    def late(self) -> dict[str, int]:
        """Frames by which pictures come later than the others', by the name of the late camera."""
        return {fault.cameras[0]: fault.offset for fault in self.faults if fault.offset}

    @property
    def of_all(self) -> Fault | None:
        """The first fault that leaving out one camera cannot mend; None without any."""
        return next(
            (
                fault
                for fault in self.faults
                if fault.kind in _OF_ALL or (fault.kind == "disagrees" and not fault.cameras)
            ),
            None,
        )

    @property
    def blind(self) -> tuple[Fault, ...]:
        """The faults of cameras whose pictures show nothing."""
        return tuple(fault for fault in self.faults if fault.kind == "empty" and fault.cameras)

    @property
    def blind_cameras(self) -> set[str]:
        """The names of the cameras whose pictures show nothing."""
        return _name_cameras(self.blind)

    @property
    def left_out(self) -> tuple[Fault, ...]:
        """The faults by which cameras tell nothing or mislead: all that are blind, and others as
        long as they are no more than a third."""
        spoilt, most = tuple(fault for fault in self.faults if fault.spoils), len(self.views.rig)
        faults = spoilt if 3 * len(_name_cameras(spoilt)) <= most else self.blind
        return faults if len(_name_cameras(faults)) + 2 <= most else ()


def _name_cameras(faults: Iterable[Fault]) -> set[str]:
    """Return the names of the cameras of some faults."""
    return {name for fault in faults for name in fault.cameras}


def diagnose(session: Session) -> Diagnosis:
    """Find the faults of a session's footage in small pictures of some hundred frames."""
    key = "diagnosis", session.device.name  # an earlier session may have found them
    return session.compute_once(
        diagnose, lambda: session.sequence.recall(key, lambda: _find_faults(session))
    )


def _find_faults(session: Session) -> Diagnosis:
    views = small_views(session.sequence, session.device)
    evidence = Evidence(session.sequence, views)
    for test in TESTS:
        # A calibration that cannot be, exchanged pictures, or too few that show anything.
        stops = any(fault.kind in ("calibration", *_REARRANGED) for fault in evidence.known)
        if test in _COMPARING and (stops or len(evidence.sound) < 2):
            continue
        for fault in list(test(evidence)):
            evidence.add(fault)
    rearranged = [fault for fault in evidence.known if fault.kind in _REARRANGED]
    faults = rearranged[:1] or sorted(evidence.known, key=lambda fault: not fault.spoils)
    return Diagnosis(faults, views)


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
        if self.diagnosis is None or not self.diagnosis.blind:
            return
        n_cameras, n_blind = len(self.diagnosis.views.rig), len(self.diagnosis.blind_cameras)
        if n_blind + 1 >= n_cameras:
            raise InputError(
                f"{self.session.sequence.name}: {n_blind} of {n_cameras} cameras show nothing "
                f"of a person, expected two or more that do; {self.diagnosis.blind[0]}"
            )

    @property
    def warnings(self) -> list[str]:
        """The cameras left out and the other serious faults, one line each."""
        return [*(f"left out: {fault}" for fault in self.left_out), *self.remaining]

    @property
    def remaining(self) -> list[str]:
        """The serious faults other than those of cameras that were left out."""
        gone = _name_cameras(self.left_out)
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
    agreed = diagnosis.of_all is None
    if diagnosis.of_all is not None and diagnosis.of_all.kind not in _OF_ALL:
        # Furniture, or small errors of the rig, may be why the cameras do not agree.
        corrected = _correct_rig(session, diagnosis)
        again = diagnose(corrected)
        if again.of_all is None:
            session, diagnosis = corrected, again
    if diagnosis.of_all is not None:
        return Examination(session, diagnosis)
    left_out = diagnosis.left_out
    if all_cameras or session.sequence.settings.cameras is not None:
        left_out = ()
    gone = _name_cameras(left_out)
    if gone:
        names = [name for name in session.rig.names if name not in gone]
        session = session.with_sequence(session.sequence.with_cameras(names))
    if agreed:
        session = _correct_rig(session, diagnosis)
    return Examination(session, diagnosis, left_out)


def _correct_rig(session: Session, diagnosis: Diagnosis) -> Session:
    """Return a session whose rig has the pixels hidden by furniture and corrected directions."""
    key = ("hidden pixels", session.settings), session.device.name
    hidden = session.sequence.recall(key, lambda: find_hidden_pixels(session))
    if hidden is not None:
        session = session.with_sequence(session.sequence.with_rig(session.rig.with_hidden(hidden)))
    rig = correct_rig(session, diagnosis.views)
    if rig is session.rig:
        return session
    return session.with_sequence(session.sequence.with_rig(rig))


def synchronise(session: Session) -> Session:
    """Return the session or, if `sync` is "auto", one whose late cameras are shifted, and whose
    cameras are followed where their clocks run differently."""
    if session.sequence.settings.sync != "auto":
        return session
    result = diagnose(session)
    if result.of_all is not None:
        return session.with_sequence(session.sequence.synchronise(result.late))
    return session.with_sequence(follow_clocks(session, result.late, len(result.views.frames)))


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
