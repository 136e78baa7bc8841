"""Agreement of a tracked body with the silhouettes of a take: whether the track is of that take."""

from __future__ import annotations

import numpy as np

from cl import InputError
from psfs.cameras.camera import CameraRig
from psfs.common.numbers import pick_evenly
from psfs.session import Session
from psfs.silhouettes.hidden import UNKNOWN
from psfs.voxels.body_prior import TrackedBody

#: Frames in which the track is compared with the silhouettes; least share of the body's axes that
#: lies on silhouettes: below it, the track is of another take.
_SAMPLES, _LEAST_AGREEMENT = 5, 0.4


def check_body(session: Session, body: TrackedBody) -> None:
    """Raise InputError if the body lacks one of the session's frames, or if it does not lie on the
    silhouettes, see `_LEAST_AGREEMENT`."""
    body.check_frames(session.frames)
    known = [i for i in session.frames if np.isfinite(body[i]).all(-1).any()]
    if not known:
        raise InputError(
            f"{body.path}: the person is lost in all frames; expected some with a body"
        )
    indices = [known[i] for i in pick_evenly(len(known), _SAMPLES)]
    shares = [
        share_on_silhouettes(session.rig, evidence, body[index])
        for index, evidence in zip(indices, session.evidence(indices), strict=True)
    ]
    share = float(np.nanmean(shares)) if np.isfinite(shares).any() else 0.0
    if share < _LEAST_AGREEMENT:
        raise InputError(
            f"{body.path}: {share:.0%} of the body's axes lie on the silhouettes of "
            f"{session.sequence.name}; expected {_LEAST_AGREEMENT:.0%} or more, as a track "
            "of that take has"
        )


def share_on_silhouettes(rig: CameraRig, evidence: np.ndarray, cones: np.ndarray) -> float:
    """Return the share of points on the axes of cones (C, 16) that lie on foreground, over all
    cameras that see them; NaN if none does. evidence: (V, H, W) int8."""
    known = cones[np.isfinite(cones).all(-1)]
    ends = known[:, 0:3], known[:, 4:7]
    points = np.concatenate([*ends, (ends[0] + ends[1]) / 2])
    seen = []
    for camera, counts in zip(rig, evidence, strict=True):
        _, row, column, _ = camera.look_up(points)
        seen.append(counts[row, column])
    counts = np.concatenate(seen)
    counts = counts[counts != UNKNOWN]
    return float((counts > 0).mean()) if counts.size else float("nan")
