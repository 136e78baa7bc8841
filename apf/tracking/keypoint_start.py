"""A take's body and first pose by its keypoints."""

from __future__ import annotations

import numpy as np

from apf.backend import tracker_for
from apf.body import BodyModel
from apf.filters.method import Method
from apf.initialisation.from_keypoints import KeypointStart, start_from_keypoints
from apf.keypoints.keypoints import Keypoints
from apf.scene import Scene
from cl import Device, InputError, NumpyDevice
from psfs.sequence import Sequence


def method_with(method: Method, keypoints: Keypoints | None) -> Method:
    """Return the method with its term of keypoints where there are any. Raises InputError for a
    method that needs some without any."""
    if keypoints is not None:
        return method.with_keypoints(keypoints.points.shape[0] * keypoints.points.shape[2])
    if method.uses_keypoints:
        raise InputError("a likelihood with keypoints, but none were given; expected some")
    return method


def learnt(
    device: Device | NumpyDevice,
    sequence: Sequence,
    keypoints: Keypoints,
    template: BodyModel,
    method: Method,
    given: tuple[BodyModel, np.ndarray] | None,
    selection: slice | None,
    height: float | None,
    keep_shape: bool,
) -> tuple[KeypointStart, tuple[BodyModel, np.ndarray]]:
    """Return what the keypoints of the selected frames say of the person, and body and first pose
    (D,): the given ones, whose points are learnt then, or those that the keypoints say."""
    frames = range(len(sequence))[selection or slice(None)]
    body = template if given is None else given[0]
    keep_shape = keep_shape or given is not None
    witness = start_from_keypoints(sequence.rig, keypoints, body, frames, height, keep_shape)
    if given is None:
        given = witness.body, _first_pose(device, sequence, witness, method, frames)
    return witness, given


def _first_pose(
    device: Device | NumpyDevice,
    sequence: Sequence,
    witness: KeypointStart,
    method: Method,
    frames: range,
) -> np.ndarray:
    """The pose (D,) in the first of `frames`, to which the body is tracked from the anchor by
    keypoints alone: those of the first frames may be few or exchanged."""
    anchor, pose = witness.anchored
    back = frames[: frames.index(anchor)][::-1]
    alone = Method.of(objective="keypoints", seed=method.filter.search.seed)
    alone = alone.with_keypoints(method.filter.keypoints.room)
    scaled = alone.replace(filter=alone.filter.at_rate(sequence.fps / abs(frames.step)))
    tracker = tracker_for(Scene(device, sequence.rig, None, witness.body), scaled)
    tracker.start(pose)
    for frame in back:
        pose = tracker.step(None, witness.observations(frame)).pose
    return pose
