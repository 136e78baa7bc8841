"""Pictures with the bodies of a run drawn over them."""

from __future__ import annotations

from functools import partial

import numpy as np

from apf.body.kinematics import posed_cones
from apf.report.overlay import compose_mosaic
from apf.report.people_page import DrawnPerson, draw_everybody, light_colour
from apf.studio.opened import OpenedTracks
from psfs.sequence import Frame


def draw_people(frame: Frame, opened: OpenedTracks, view: int | None) -> np.ndarray:
    """Return the picture (h, w, 3) uint8 BGR of a frame with all bodies; of one camera (its index)
    or, for None, of all."""
    assert opened.sequence is not None
    people: list[DrawnPerson] = []
    for number, (name, track) in enumerate(opened.tracks.items()):
        row = opened.rows[name].get(frame.index)
        if row is None or track.lost[row]:
            continue
        body = track.its_body
        drawn = [k for k, cone in enumerate(body.cones) if cone.in_images]
        people.append(
            DrawnPerson(
                posed_cones(body, track.poses[[row]])[0, drawn],
                [body.cone_names[k] for k in drawn],
                track.joints[row],
                track.edges,
                light_colour(number) if len(opened.tracks) > 1 else None,
            )
        )
    views = None if view is None else [view]
    return compose_mosaic(frame, opened.sequence.rig, partial(draw_everybody, people), views)
