"""The second pass over a take: the person's own body, and poses that fit it.

The first pass tracks the body of the start, which a second of the take has measured. Then all
frames together say more of the person, see `apf.initialisation.personal`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from apf.body.kinematics import posed_joints
from apf.body.limbs import add_ankles
from apf.body.model import BodyModel
from apf.body.surface import Surface
from apf.initialisation.personal import Outlines, PersonalFit
from apf.initialisation.surface import fit_surface
from apf.tracking.track import Track
from apf.tracking.two_way import SMOOTHED_SECONDS, smooth_poses


def fit_personal_body(
    tracks: Sequence[Track], template: BodyModel, outlines: Mapping[int, Outlines], fps: float
) -> tuple[list[Track], Callable[[], Surface] | None]:
    """Return the tracks of a take with the person's own body, measured along the first of them, and
    poses that fit it to the `outlines` of the frames; and what fits the person's surface to them.
    Frames in which the person was lost stay as they were. template: the body of the start. fps:
    frames tracked per second."""
    first = tracks[0]
    fit = PersonalFit(add_ankles(template))
    tracked, outlined = _find_shown(first, outlines)
    measures, covariance = fit.measure(outlined, _with_ankles(first.poses, fit)[tracked])
    body = fit.shape.body(measures)
    lengths = fit.length_deviations(measures, covariance)
    fitted = []
    for track in tracks:
        rows, shown = _find_shown(track, outlines)
        poses, diagnostics = _with_ankles(track.poses, fit), dict(track.diagnostics)
        poses[rows] = fit.pose(measures, shown, poses[rows])
        poses = smooth_poses(body, poses, rows, round(SMOOTHED_SECONDS * fps) | 1)
        stated = np.array(track.covariance)
        stated[rows] = fit.joint_covariance(measures, covariance, shown, poses[rows])
        diagnostics["covariance"] = stated
        if "deviation" in diagnostics:
            diagnostics["deviation"] = _with_ankles(diagnostics["deviation"], fit)
        joints = posed_joints(body, poses)
        fitted.append(
            replace(
                track, body=body, dof_names=body.dof_names, poses=poses, joints=joints,
                diagnostics=diagnostics,
            )
        )  # fmt: skip
    surface = partial(fit_surface, body, outlined, fitted[0].poses[tracked], lengths)
    return fitted, surface if outlined else None


def _find_shown(
    track: Track, outlines: Mapping[int, Outlines]
) -> tuple[np.ndarray, list[Outlines]]:
    """Return in which frames (F,) bool of a track the person is tracked and shown, and their
    outlines."""
    rows = ~track.lost & np.isin(track.frames, list(outlines))
    return rows, [outlines[int(index)] for index in track.frames[rows]]


def _with_ankles(poses: np.ndarray, fit: PersonalFit) -> np.ndarray:
    """Return poses (F, D') of the fitted body from those (F, D) of one without ankles."""
    return np.pad(poses, ((0, 0), (0, fit.template.n_dof - poses.shape[1])))
