"""The first pose: read from a file, or fitted to 3-D joints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from cl import InputError
from psfs.cameras.names import listed
from psfs.common.files import read_numbers, written_whole

#: Standard deviations of the fit: a joint's position, m, a bone's length (log of its scale), and
#: an angle's distance from rest, rad. The last two only decide what the joints leave open.
_JOINT_SIGMA, _SCALE_SIGMA, _ANGLE_SIGMA = 0.01, 0.3, 3.0
#: Of the differences that tell derivatives, rad, m or log of a scale.
_STEP = 1e-7
#: Known joints that are asked for, or all of a body with fewer.
_LEAST_JOINTS = 8
#: Evaluations after which the best of the headings is gone on with.
_TRIAL = 8


def read_pose(path: Path, body: BodyModel) -> np.ndarray:
    """The first pose (D,) m, rad of a text file with one value per degree of freedom.

    Raises InputError naming the file if it is missing, not numbers, or of another body.
    """
    values = read_numbers(path)
    if values.size < body.n_dof or not np.isfinite(values).all():
        raise InputError(
            f"{path}: {values.size} values; expected {body.n_dof} finite ones, "
            f"one per degree of freedom of {body.name}"
        )
    return values[: body.n_dof]


def write_pose(path: Path, pose: np.ndarray) -> None:
    """Write `pose` (D,) as a text file that `read_pose` reads back."""
    with written_whole(path) as temporary:
        np.savetxt(temporary, pose, fmt="%.9g")


def fit_to_joints(
    body: BodyModel, joints: Mapping[str, np.ndarray]
) -> tuple[BodyModel, np.ndarray, float]:
    """Body with bone lengths scaled to `joints` (name -> (3,) m), its pose (D,), rms error m.

    Least squares over pose and one scale per bone (left and right share one), from the best of
    four headings. Radii grow with the mean length. Raises InputError if fewer than 8 known joints,
    or not all of a body with fewer, are given.
    """
    names = _known(body, joints)
    target = np.stack([joints[name] for name in names])
    chosen = [body.joint_names.index(name) for name in names]
    groups = body.scale_groups
    free = np.clip(body.rest_pose, body.lower, body.upper)

    def unpack(x: np.ndarray) -> tuple[BodyModel, np.ndarray]:
        scales = np.exp(x[body.n_dof :])
        return body.scaled(dict(zip(groups, scales, strict=True))), x[: body.n_dof]

    def residuals(x: np.ndarray) -> np.ndarray:
        scaled, pose = unpack(x)
        reached = posed_joints(scaled, pose[None])[0, chosen]
        return np.concatenate(
            [
                ((reached - target) / _JOINT_SIGMA).ravel(),
                x[body.n_dof :] / _SCALE_SIGMA,
                (pose - body.rest_pose)[body.angles] / _ANGLE_SIGMA,
            ]
        )

    # Of what does not depend on the joints.
    n = body.n_dof + len(groups)
    priors = [np.eye(n)[body.n_dof :] / _SCALE_SIGMA, np.eye(n)[body.angles] / _ANGLE_SIGMA]

    def jacobian(x: np.ndarray) -> np.ndarray:
        """By differences, those of the pose all at once."""
        scaled, pose = unpack(x)
        reached = posed_joints(scaled, np.vstack([pose, pose + _STEP * np.eye(body.n_dof)]))
        stretched = [unpack(x + _STEP * unit)[0] for unit in np.eye(n)[body.n_dof :]]
        reached = np.concatenate([reached, *(posed_joints(s, pose[None]) for s in stretched)])
        moves = (reached[1:, chosen] - reached[0, chosen]) / _STEP
        return np.concatenate([moves.reshape(n, -1).T / _JOINT_SIGMA, *priors])

    lower = np.concatenate([body.lower, np.full(len(groups), -1.0)])
    upper = np.concatenate([body.upper, np.full(len(groups), 1.0)])

    def solved(start: np.ndarray, most: int | None) -> Any:
        inside = np.clip(start, lower + 1e-9, upper - 1e-9)
        return least_squares(residuals, inside, jacobian, bounds=(lower, upper), max_nfev=most)

    poses = [_root_at(body, free, target.mean(0), k * np.pi / 2) for k in range(4)]
    tried = [solved(np.concatenate([pose, np.zeros(len(groups))]), _TRIAL) for pose in poses]
    best = solved(min(tried, key=lambda solution: solution.cost).x, None)
    scaled, pose = unpack(best.x)
    offset = posed_joints(scaled, pose[None])[0, chosen] - target
    error = float(np.sqrt(np.mean(np.sum(offset**2, -1))))
    scales = dict(zip(groups, np.exp(best.x[body.n_dof :]), strict=True))
    girth = float(np.mean(list(scales.values())))
    return body.scaled(scales, radii=girth), pose, error


def _known(body: BodyModel, joints: Mapping[str, np.ndarray]) -> list[str]:
    """The body's joints that are given. Raises InputError if they are too few."""
    least = min(_LEAST_JOINTS, len(body.joints))
    names = [n for n in body.joint_names if n in joints and np.isfinite(joints[n]).all()]
    if len(names) < least:
        raise InputError(
            f"{len(names)} known joints to start from ({listed(names)}); "
            f"expected at least {least} of: {', '.join(body.joint_names)}"
        )
    return names


def _root_at(body: BodyModel, pose: np.ndarray, centre: np.ndarray, heading: float) -> np.ndarray:
    """`pose` moved so that its joints' mean is `centre` and turned by `heading` about z."""
    pose = pose.copy()
    root = {axis.kind: axis for axis in body.bones[0].axes}
    if "rz" in root:
        pose[root["rz"].dof] += heading
    offset = centre - posed_joints(body, pose[None])[0].mean(0)
    for kind, value in zip(("tx", "ty", "tz"), offset, strict=True):
        if kind in root:
            pose[root[kind].dof] += root[kind].sign * value
    return pose
