"""The second pass over a take: the person's own body, and poses that fit it.

The first pass tracks the body of the start, which a second of the take has measured. Then all
frames together say more of the person, see `apf.initialisation.personal`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from apf.body.kinematics import posed_joints
from apf.body.limbs import add_ankles
from apf.body.model import BodyModel
from apf.initialisation.personal import Outlines, PersonalFit
from apf.initialisation.surface import fit_surface
from apf.tracking.track import Track
from apf.tracking.two_way import SMOOTHED_SECONDS, smooth_poses

#: Completes the tracks of a person's own body after the last pass.
Complete: TypeAlias = Callable[[Sequence[Track]], list[Track]]


def fit_personal_body(
    tracks: Sequence[Track], template: BodyModel, outlines: Mapping[int, Outlines], fps: float
) -> tuple[list[Track], Complete]:
    """Return the tracks of a take with the person's own body, measured along the first of them, and
    poses that fit it to the `outlines` of the frames; and what completes them after the last pass:
    with the uncertainty of the joints, and the surface. Frames in which the person was lost stay as
    they were. template: the body of the start. fps: frames tracked per second."""
    fit = PersonalFit(add_ankles(template))
    of_each = [_find_shown(track, outlines) for track in tracks]
    tracked, outlined = of_each[0]
    measures, covariance = fit.measure(outlined, _with_ankles(tracks[0].poses, fit)[tracked])
    body = fit.shape.body(measures)
    fitted = []
    for track, (rows, visible) in zip(tracks, of_each, strict=True):
        poses, diagnostics = _with_ankles(track.poses, fit), dict(track.diagnostics)
        poses[rows] = fit.pose(measures, visible, poses[rows])
        poses = smooth_poses(body, poses, rows, round(SMOOTHED_SECONDS * fps) | 1)
        if "deviation" in diagnostics:
            diagnostics["deviation"] = _with_ankles(diagnostics["deviation"], fit)
        joints = posed_joints(body, poses)
        fitted.append(
            replace(
                track, body=body, dof_names=body.dof_names, poses=poses, joints=joints,
                diagnostics=diagnostics,
            )
        )  # fmt: skip

    def complete(last: Sequence[Track]) -> list[Track]:
        lengths, completed = fit.length_deviations(measures, covariance), list[Track]()
        fitted_poses = fitted[0].poses[tracked]
        with ThreadPoolExecutor(1) as thread:
            begun = None
            if outlined:
                begun = thread.submit(fit_surface, body, outlined, fitted_poses, lengths)
            for track, (rows, visible) in zip(last, of_each, strict=True):
                poses, stated = track.poses[rows], np.array(track.covariance)
                stated[rows] = fit.joint_covariance(measures, covariance, visible, poses)
                diagnostics = {**track.diagnostics, "covariance": stated}
                completed.append(replace(track, diagnostics=diagnostics))
        surface = begun.result() if begun else None
        return [replace(track, surface=surface) for track in completed]

    return fitted, complete


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
