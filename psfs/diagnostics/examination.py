"""Examination of the footage before work: its faults, and the cameras to leave out."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

from psfs.diagnostics.alignment import correct_rig
from psfs.diagnostics.camera_consistency import InconsistentCamera, find_inconsistent_cameras
from psfs.diagnostics.fault import Fault
from psfs.diagnostics.faults import Diagnosis, diagnose
from psfs.diagnostics.occluders import find_hidden_pixels
from psfs.session import Session
from psfs.silhouettes.config import SilhouetteConfig

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Examination:
    """The result of `examine`.

    session: the session to work in, without the cameras that were left out, with late cameras
    shifted and the rig corrected. diagnosis: the footage's faults; None if it was not examined.
    left_out: the cameras that were left out.
    """

    session: Session
    diagnosis: Diagnosis | None = None
    left_out: tuple[InconsistentCamera, ...] = ()

    @property
    def faults(self) -> list[Fault]:
        """The faults of the footage, the most serious first."""
        return [] if self.diagnosis is None else self.diagnosis.faults

    @property
    def warnings(self) -> list[str]:
        """The cameras left out and the other serious faults, one line each."""
        return [*(f"left out: {camera}" for camera in self.left_out), *self.remaining]

    @property
    def remaining(self) -> list[str]:
        """The serious faults other than those of cameras that were left out."""
        gone = {camera.camera for camera in self.left_out}
        return [str(f) for f in self.faults if f.serious and not gone & set(f.cameras)]


def examine(session: Session, all_cameras: bool = False) -> Examination:
    """Diagnose the footage, shift late cameras, correct the rig and leave out inconsistent cameras.

    Late cameras are shifted if the sequence's `sync` is "auto". Cameras that disagree with the
    others (see `find_inconsistent_cameras`) are left out, unless `all_cameras` is true, the
    sequence was opened with `cameras`, or the fault is not that of a single camera. The rig gets
    the pixels where furniture hides people (see `find_hidden_pixels`), and its cameras are turned
    if they are off (see `correct_rig`).
    """
    diagnosis = diagnose(session)
    if session.sequence.settings.sync == "auto":
        session = session.with_sequence(session.sequence.synchronise(diagnosis.late))
        diagnosis = diagnosis.without("late")
    if diagnosis.concerns_all:
        return Examination(session, diagnosis)
    corrected = _correct_rig(session, diagnosis)
    if all_cameras or session.sequence.settings.cameras is not None:
        return Examination(corrected, diagnosis)
    found = tuple(
        find_inconsistent_cameras(_with_default_silhouettes(corrected), diagnosis.reasons)
    )
    if not found:
        return Examination(corrected, diagnosis)
    gone = {camera.camera for camera in found}
    kept = [name for name in session.rig.names if name not in gone]
    session = session.with_sequence(session.sequence.with_cameras(kept))
    return Examination(_correct_rig(session, diagnosis), diagnosis, found)


def _correct_rig(session: Session, diagnosis: Diagnosis) -> Session:
    """Return a session whose rig has the pixels hidden by furniture and corrected directions."""
    hidden = find_hidden_pixels(session)
    if hidden is not None:
        session = session.with_sequence(session.sequence.with_rig(session.rig.with_hidden(hidden)))
    found = correct_rig(session, diagnosis.views)
    if found is None:
        return session
    log.info("%s: %s", session.sequence.name, found)
    return session.with_sequence(session.sequence.with_rig(found.rig))


def _with_default_silhouettes(session: Session) -> Session:
    """Return a session with the default silhouette settings, the same session if it has them.

    Silhouettes of other settings, such as a paper's, may be too poor to judge a camera by.
    """
    usual = SilhouetteConfig()
    if session.reconstruction.silhouette == usual:
        return session
    reconstruction = session.reconstruction.replace(silhouette=usual)
    settings = replace(session.settings, reconstruction=reconstruction)
    return Session(session.sequence, session.device, settings)


def synchronise(session: Session) -> Session:
    """Return the session or, if `sync` is "auto", one whose late cameras are shifted."""
    if session.sequence.settings.sync != "auto":
        return session
    return session.with_sequence(session.sequence.synchronise(diagnose(session).late))
