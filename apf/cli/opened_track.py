"""Read the track that is given to a command, with its body."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from apf.body.kinematics import posed_cones, posed_joints
from apf.body.model import BodyModel
from apf.body.toml import load_body
from apf.request import ExportRequest, SmoothRequest
from apf.tracking.track import Track
from cl import InputError


def _same(own: BodyModel, other: BodyModel) -> bool:
    """Return whether two bodies are equal up to the rounding of their files."""
    cones = [posed_cones(body, own.rest_pose[None]) for body in (own, other)]
    joints = [posed_joints(body, own.rest_pose[None]) for body in (own, other)]
    return own.dof_names == other.dof_names and all(
        a.shape == b.shape and np.allclose(a, b, atol=1e-6) for a, b in (cones, joints)
    )


def open_given_track(path: Path, body: Path | None, cutoff: float | None = None) -> Track:
    """Return the track at `path`, with the body of a file if it holds none of its own. cutoff: of
    the smoothing, Hz, if it is stated. Raises InputError, also if a body is needed and the track
    holds none."""
    track = Track.open(path)
    if not len(track):
        raise InputError(f"{path}: holds no tracked frame; expected at least one")
    if cutoff is not None and cutoff >= track.fps / 2:
        raise InputError(
            f"--cutoff is {cutoff:g} Hz, which smooths nothing; expected less than half of "
            f"the track's {track.fps:g} frames per second"
        )
    try:
        if body is not None:
            given, own = load_body(body), track.body
            if own is not None and not _same(own, given):
                raise InputError(f"holds its body, which is not that of --body {body}")
            track = replace(track, body=own or given)
        if track.dof_names:
            _ = track.its_body
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return track


def stated_cutoff(request: ExportRequest | SmoothRequest) -> float | None:
    """Return the cutoff, Hz, that a request states; None for the default."""
    return request.smoothing.cutoff if "cutoff" in request.chosen else None
