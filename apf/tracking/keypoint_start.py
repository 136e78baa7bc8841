"""Body and first pose of a take from its keypoints."""

from __future__ import annotations

import numpy as np

from apf.backend import make_tracker
from apf.body.model import BodyModel
from apf.filters.method import Method
from apf.initialisation.from_keypoints import KeypointStart, start_from_keypoints
from apf.scene import Scene
from apf.tracking.settings import TakeSettings
from psfs.session import Session


def fit_to_keypoints(
    session: Session, settings: TakeSettings
) -> tuple[KeypointStart, tuple[BodyModel, np.ndarray]]:
    """Return the fit to the keypoints of the selected frames, the body and its first pose (D,).

    If the settings give body and pose, they are returned unchanged, and only the positions of the
    keypoints on the body are fitted. Otherwise both are estimated from the keypoints. The settings
    must have keypoints.
    """
    assert settings.keypoints is not None
    given = settings.given
    body = settings.body_template if given is None else given[0]
    start = start_from_keypoints(
        session.rig, settings.keypoints, body, session.frames,
        height=settings.height, keep_shape=settings.keep_shape or given is not None,
    )  # fmt: skip
    if given is None:
        given = start.body, _first_pose(session, start, settings.tracked_method)
    return start, given


def _first_pose(session: Session, start: KeypointStart, method: Method) -> np.ndarray:
    """Return the pose (D,) in the first of the session's frames.

    The body is tracked from the anchor frame back to the first one by keypoints alone, because the
    first frames may have few keypoints or exchange left and right.
    """
    anchor, pose = start.anchored
    frames = session.frames
    back = frames[: frames.index(anchor)][::-1]
    alone = Method.create(objective="keypoints", seed=method.filter.search.seed)
    alone = alone.with_keypoints(method.filter.keypoints.room)
    scaled = alone.replace(filter=alone.filter.scale_to_rate(session.rate))
    tracker = make_tracker(Scene(session.device, session.rig, None, start.body), scaled)
    tracker.start(pose)
    for frame in back:
        pose = tracker.step(None, start.observations(frame)).pose
    return pose
