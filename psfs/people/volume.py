"""The volume of all people who are reconstructed together."""

from __future__ import annotations

import numpy as np

from psfs.people.people import count_people
from psfs.session import Session
from psfs.volume import VOLUME_MARGIN, Volume, find_volume
from psfs.voxels.body_prior import TrackedBody


def extend_to_people(session: Session, body: TrackedBody | None = None) -> None:
    """Extend the volume, unless one is stated, to all of several people: those of a track, or those
    who are counted. The volume that is found by itself holds the largest of each frame."""
    box = _box_of_several(session, body)
    if box is None:
        return
    found, (low, high) = find_volume(session), box
    margin = VOLUME_MARGIN * (high - low)
    session.replace_result(
        find_volume,
        Volume(np.minimum(found.low, low - margin), np.maximum(found.high, high + margin)),
    )


def _box_of_several(
    session: Session, body: TrackedBody | None
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the box around several people; None of a single one, or if a volume is stated."""
    sequence = session.sequence
    if sequence.volume is not None:
        return None
    if body is not None:
        return body.box() if body.several else None
    if sequence.subject != "person" or len(session.rig) < 2:
        return None
    people = count_people(session)
    return people.box() if len(people) > 1 else None
