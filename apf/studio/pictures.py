"""Pictures with the bodies of a run drawn over them."""

from __future__ import annotations

import numpy as np

from apf.body.kinematics import posed_cones
from apf.report.overlay import overlay_picture
from apf.studio.opened import OpenedTracks
from psfs.sequence import Frame


def draw_people(frame: Frame, opened: OpenedTracks, view: int | None) -> np.ndarray:
    """Return the picture (h, w, 3) uint8 BGR of a frame with all bodies; of one camera (its index)
    or, for None, of all."""
    assert opened.sequence is not None
    cones: list[np.ndarray] = []
    names: list[str] = []
    joints: list[np.ndarray] = []
    edges: list[np.ndarray] = []
    for name, track in opened.tracks.items():
        row = opened.rows[name].get(frame.index)
        if row is None or track.lost[row]:
            continue
        body = track.its_body
        drawn = [number for number, cone in enumerate(body.cones) if cone.in_images]
        edges.append(track.edges + sum(len(of) for of in joints))
        cones.append(posed_cones(body, track.poses[[row]])[0, drawn])
        names += [body.cone_names[number] for number in drawn]
        joints.append(track.joints[row])
    empty = np.zeros((0, 16)), np.zeros((0, 3)), np.zeros((0, 2), int)
    whole = [
        np.concatenate([of_none, *of])
        for of_none, of in zip(empty, (cones, joints, edges), strict=True)
    ]
    return overlay_picture(
        frame, opened.sequence.rig, whole[0], names, whole[1], whole[2],
        views=None if view is None else [view],
    )  # fmt: skip
