"""Fit the first pose to 3-D joints."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from apf.body.kinematics import posed_joints
from apf.body.limbs import limb_chains
from apf.body.model import BodyModel
from apf.body.schema import TALLEST
from apf.initialisation.body_fit import Fitted, PointEvidence, fit_body
from apf.initialisation.shape_model import ShapeModel
from cl import InputError
from psfs.cameras.names import join_names
from psfs.common.ranges import FARTHEST

#: Standard deviation, m, of a joint's position: small, so that the person's lengths are the joints'
#: where these show them.
_NOISE = 0.001
#: Least number of known joints, or all joints of a body with fewer: enough for the root, and a
#: joint in every limb. Least extent, m, of the joints of a person to start from.
_LEAST_JOINTS, LEAST_EXTENT = 8, 0.1


def fit_to_joints(
    body: BodyModel, joints: Mapping[str, np.ndarray]
) -> tuple[BodyModel, np.ndarray, float]:
    """Fit body and pose to `joints` (name -> (3,) m). Return the body with scaled bone lengths, its
    pose (D,) and the rms error, m.

    Least squares over the pose, the size and one scale per bone (shared by left and right). Radii
    are scaled by the size. Raises InputError if fewer than 8 known joints are given, or, for a body
    with fewer joints, not all of them.
    """
    names = _select_given_joints(body, joints)
    target = np.stack([joints[name] for name in names])
    extent = float(np.ptp(target, axis=0).max())
    if not LEAST_EXTENT <= extent <= TALLEST or np.abs(target).max() > FARTHEST:
        raise InputError(
            f"the joints to start from span {extent:.3g} m, {np.abs(target).max():.3g} m from the "
            f"origin; expected a person in metres, {LEAST_EXTENT:g} to {TALLEST:g} m"
        )
    chosen = [body.joints[body.joint_names.index(name)] for name in names]
    evidence = PointEvidence(
        bone=np.array([joint.bone for joint in chosen]),
        position=np.stack([joint.position for joint in chosen]),
        partner=np.arange(len(chosen)),
        spreads=np.full(len(chosen), 1e-6),  # joints are where the body has them
        places=target[None],
        noise=_NOISE,
        robust=False,
    )
    model = ShapeModel(body)
    start = stand_at_points(model, evidence, scaled=True)
    found = fit_body(model, evidence, start, free=model.moves_points, steps=100)
    fitted = model.body(found.shape)
    offset = posed_joints(fitted, found.poses)[0, [body.joint_names.index(n) for n in names]]
    error = float(np.sqrt(np.mean(np.sum((offset - target) ** 2, -1))))
    return fitted, found.poses[0], error


def _select_given_joints(body: BodyModel, joints: Mapping[str, np.ndarray]) -> list[str]:
    """Return the body's joints that are given. Raises InputError if there are too few."""
    least = min(_LEAST_JOINTS, len(body.joints))
    names = [n for n in body.joint_names if n in joints and np.isfinite(joints[n]).all()]
    if len(names) < least:
        raise InputError(
            f"{len(names)} known joints to start from ({join_names(names)}); "
            f"expected at least {least} of: {', '.join(body.joint_names)}"
        )
    return names


def stand_at_points(model: ShapeModel, evidence: PointEvidence, scaled: bool) -> Fitted:
    """Return the fit to begin with: rest poses, turned and moved to the places of the points of the
    trunk. A frame with too few of them gets the pose of an earlier one. scaled: whether to estimate
    the size, the median over pairs of neighbouring points of the ratio of their distances."""
    body, n_offsets = model.template, len(evidence.spread)
    rest = np.clip(body.rest_pose, body.lower, body.upper)
    fit = Fitted(np.zeros(len(model.deviation)), rest[None], np.zeros((n_offsets, 3)))
    if scaled:
        fit.shape[0] = _measure_size(body, evidence, evidence.locate(model, fit)[0])
    at_rest = evidence.locate(model, fit)[0]
    swinging = [bone for chain in limb_chains(body) for bone in chain[-2:]]
    trunk = ~np.isin(evidence.bone, swinging)
    root = {axis.kind: axis for axis in body.bones[0].axes}
    poses = np.tile(rest, (len(evidence.places), 1))
    for frame, places in enumerate(evidence.places):
        known = trunk & np.isfinite(places).all(1)
        if known.sum() < 3:
            poses[frame:] = poses[max(0, frame - 1)]
            continue
        poses[frame] = rest
        if "rz" in root:
            turn = _measure_heading(at_rest[known], places[known])
            poses[frame, root["rz"].dof] += root["rz"].sign * turn
        here = evidence.locate(model, Fitted(fit.shape, poses[frame][None], fit.offsets))[0]
        move = (places - here)[known].mean(0)
        for kind, value in zip(("tx", "ty", "tz"), move, strict=True):
            if kind in root:
                poses[frame, root[kind].dof] += root[kind].sign * value
    return Fitted(fit.shape, poses, fit.offsets)


def _measure_size(body: BodyModel, evidence: PointEvidence, rest: np.ndarray) -> float:
    """Return the log of the person's size. Points on the trunk and along limbs are compared, whose
    distances posture changes little; `rest`: (P, 3) m of the template."""
    parent = [body.bones[bone].parent for bone in evidence.bone]
    logs = []
    for b, bone in enumerate(evidence.bone):
        for a, other in enumerate(evidence.bone[:b]):
            beside = bone == parent[a] or other == parent[b] or parent[a] == parent[b]
            apart = np.linalg.norm(rest[a] - rest[b])
            if bone == other or not beside or apart < LEAST_EXTENT:
                continue
            found = np.linalg.norm(evidence.places[:, a] - evidence.places[:, b], axis=-1)
            if np.isfinite(found).any():
                logs.append(np.log(np.nanmedian(found) / apart))
    return float(np.median(logs)) if logs else 0.0


def _measure_heading(points: np.ndarray, turned: np.ndarray) -> float:
    """Return the angle, rad, of the rotation about z that best maps points (K, 3) to `turned`."""
    a, b = (p[:, :2] - p[:, :2].mean(0) for p in (points, turned))
    return float(np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b)))
