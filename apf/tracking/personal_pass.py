"""The second pass over a take: the person's own body, and poses that fit it.

The first pass tracks the body of the start, which a second of the take has measured. Then all
frames together say more of the person, see `apf.initialisation.personal`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from apf.body.kinematics import posed_joints
from apf.initialisation.personal import Outlines, PersonalFit
from apf.tracking.track import Track
from apf.tracking.two_way import SMOOTHED_SECONDS, smooth_poses


def fit_personal_body(
    tracks: Sequence[Track], outlines: Mapping[int, Outlines], fps: float
) -> list[Track]:
    """Return the tracks of a take with the person's own body, measured along the first of them, and
    poses that fit it to the `outlines` of the frames. Frames in which the person was lost stay as
    they were. fps: frames tracked per second."""
    first = tracks[0]
    assert first.body is not None
    seen = ~first.lost & np.isin(first.frames, list(outlines))
    fit = PersonalFit(first.body)
    known = [outlines[int(index)] for index in first.frames[seen]]
    measures, _ = fit.measure(known, first.poses[seen])
    body = fit.shape.body(measures)
    fitted = []
    for track in tracks:
        seen = ~track.lost & np.isin(track.frames, list(outlines))
        poses = track.poses.copy()
        known = [outlines[int(index)] for index in track.frames[seen]]
        poses[seen] = fit.pose(measures, known, poses[seen])
        poses = smooth_poses(body, poses, seen, round(SMOOTHED_SECONDS * fps) | 1)
        fitted.append(replace(track, body=body, poses=poses, joints=posed_joints(body, poses)))
    return fitted
