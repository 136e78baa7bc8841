"""The stage `diagnose`: find faults of the footage before hours are spent on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from psfs.diagnostics.arrangement_faults import find_disagreeing, find_late, find_rearranged
from psfs.diagnostics.calibration_faults import find_wrong_calibration, find_wrong_unit
from psfs.diagnostics.fault import Evidence, Fault
from psfs.diagnostics.picture_faults import (
    find_cut,
    find_empty,
    find_flicker,
    find_repeated,
    find_wrong_background,
)
from psfs.diagnostics.small_views import SmallViews, small_views
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
    def left_out(self) -> tuple[Fault, ...]:
        """The faults by which cameras tell nothing or mislead: all that are blind, and others as
        long as they are no more than a third."""
        spoilt, most = tuple(fault for fault in self.faults if fault.spoils), len(self.views.rig)
        found = spoilt if 3 * len(spoilt) <= most else self.blind
        return found if len(found) + 2 <= most else ()


def diagnose(session: Session) -> Diagnosis:
    """Find the faults of a session's footage in small pictures of some hundred frames."""
    return session.compute_once(diagnose, lambda: _find_faults(session))


def _find_faults(session: Session) -> Diagnosis:
    views = small_views(session.sequence, session.device)
    evidence = Evidence(session.sequence, views)
    for test in TESTS:
        if test in _COMPARING and _is_incomparable(evidence):
            continue
        for fault in list(test(evidence)):
            evidence.add(fault)
    rearranged = [fault for fault in evidence.known if fault.kind in _REARRANGED]
    faults = rearranged[:1] or sorted(evidence.known, key=lambda fault: not fault.spoils)
    return Diagnosis(faults, views)


def _is_incomparable(evidence: Evidence) -> bool:
    """Return whether cameras cannot be compared: a calibration that cannot be, pictures that are
    exchanged, or too few that show anything."""
    stops = ("calibration", *_REARRANGED)
    return any(f.kind in stops for f in evidence.known) or len(evidence.sound) < 2
