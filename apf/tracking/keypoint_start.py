"""A take's body and first pose by its keypoints."""

from __future__ import annotations

import numpy as np

from apf.backend import tracker_for
from apf.body import BodyModel
from apf.filters.method import Method
from apf.initialisation.from_keypoints import KeypointStart, start_from_keypoints
from apf.scene import Scene
from apf.tracking.settings import TakeSettings
from psfs.session import Session


def fit_to_keypoints(
    session: Session, settings: TakeSettings
) -> tuple[KeypointStart, tuple[BodyModel, np.ndarray]]:
    """Return what the keypoints of the selected frames show of the person, and body and first pose
    (D,): the given ones, to which the keypoints' places on the body are fitted, or those that the
    keypoints show. The settings have keypoints."""
    assert settings.keypoints is not None
    given = settings.given
    body = settings.body_template if given is None else given[0]
    witness = start_from_keypoints(
        session.rig, settings.keypoints, body, session.frames,
        height=settings.height, keep_shape=settings.keep_shape or given is not None,
    )  # fmt: skip
    if given is None:
        given = witness.body, _first_pose(session, witness, settings.tracked_method)
    return witness, given


def _first_pose(session: Session, witness: KeypointStart, method: Method) -> np.ndarray:
    """Return the pose (D,) in the first of the session's frames, to which the body is tracked from
    the anchor by keypoints alone: those of the first frames may be few or exchanged."""
    anchor, pose = witness.anchored
    frames = session.frames
    back = frames[: frames.index(anchor)][::-1]
    alone = Method.of(objective="keypoints", seed=method.filter.search.seed)
    alone = alone.with_keypoints(method.filter.keypoints.room)
    scaled = alone.replace(filter=alone.filter.at_rate(session.rate))
    tracker = tracker_for(Scene(session.device, session.rig, None, witness.body), scaled)
    tracker.start(pose)
    for frame in back:
        pose = tracker.step(None, witness.observations(frame)).pose
    return pose
