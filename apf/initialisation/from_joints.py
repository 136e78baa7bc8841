"""Fit the first pose to 3-D joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.body.toml import TALLEST
from apf.formats.pose import FARTHEST
from apf.initialisation.fit_config import JointFitConfig
from cl import InputError
from psfs.cameras.names import join_names

#: Step of the forward differences, rad, m or log of a scale: about the square root of float64's
#: resolution.
_STEP = 1e-7
#: Least extent, m, of the joints of a person to start from.
LEAST_EXTENT = 0.1


def fit_to_joints(
    body: BodyModel, joints: Mapping[str, np.ndarray], config: JointFitConfig | None = None
) -> tuple[BodyModel, np.ndarray, float]:
    """Fit body and pose to `joints` (name -> (3,) m). Return the body with scaled bone lengths, its
    pose (D,) and the rms error, m.

    Least squares over the pose and one scale per bone (shared by left and right), from the best of
    four headings. Radii are scaled by the mean length. Raises InputError if fewer than 8 known
    joints are given, or, for a body with fewer joints, not all of them.
    """
    config = config or JointFitConfig()
    names = _select_given_joints(body, joints, config)
    target = np.stack([joints[name] for name in names])
    extent = float(np.ptp(target, axis=0).max())
    if not LEAST_EXTENT <= extent <= TALLEST or np.abs(target).max() > FARTHEST:
        raise InputError(
            f"the joints to start from span {extent:.3g} m, {np.abs(target).max():.3g} m from the "
            f"origin; expected a person in metres, {LEAST_EXTENT:g} to {TALLEST:g} m"
        )
    fit = _JointFit(body, [body.joint_names.index(name) for name in names], target, config)
    best = fit.solve()
    scales, pose = fit.split(best)
    scaled = body.scaled(scales)
    offset = posed_joints(scaled, pose[None])[0, fit.chosen] - target
    error = float(np.sqrt(np.mean(np.sum(offset**2, -1))))
    girth = float(np.mean(list(scales.values())))
    return body.scaled(scales, radii=girth), pose, error


class _JointFit:
    """The least-squares problem of `fit_to_joints`. The unknowns x are the pose (D,), then the log
    of a scale for each group of bones. chosen: indices of the joints at `target` (J, 3) m."""

    def __init__(
        self, body: BodyModel, chosen: list[int], target: np.ndarray, config: JointFitConfig
    ) -> None:
        self.body, self.chosen, self.target, self.config = body, chosen, target, config
        self.groups = body.scale_groups
        self._bones = replace(body, cones=())  # joints do not depend on the cones
        self.n = body.n_dof + len(self.groups)
        # Derivatives of the residuals that do not depend on the joints.
        identity = np.eye(self.n)
        self._priors = [
            identity[body.n_dof :] / config.scale,
            identity[body.angles] / config.angle,
        ]

    def split(self, x: np.ndarray) -> tuple[dict[str, float], np.ndarray]:
        """Return the scale of each group and the pose (D,)."""
        scales = np.exp(x[self.body.n_dof :])
        return dict(zip(self.groups, scales, strict=True)), x[: self.body.n_dof]

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Return all residuals, divided by their standard deviations."""
        body, config = self.body, self.config
        scales, pose = self.split(x)
        reached = posed_joints(self._bones.scaled(scales), pose[None])[0, self.chosen]
        return np.concatenate(
            [
                ((reached - self.target) / config.joint).ravel(),
                x[body.n_dof :] / config.scale,
                (pose - body.rest_pose)[body.angles] / config.angle,
            ]
        )

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Return the derivatives by finite differences, those of the pose in one batch."""
        body, n = self.body, self.n
        scales, pose = self.split(x)
        poses = np.vstack([pose, pose + _STEP * np.eye(body.n_dof)])
        reached = posed_joints(self._bones.scaled(scales), poses)
        stretched = [
            self._bones.scaled(self.split(x + _STEP * unit)[0]) for unit in np.eye(n)[body.n_dof :]
        ]
        reached = np.concatenate([reached, *(posed_joints(s, pose[None]) for s in stretched)])
        moves = (reached[1:, self.chosen] - reached[0, self.chosen]) / _STEP
        return np.concatenate([moves.reshape(n, -1).T / self.config.joint, *self._priors])

    def solve(self) -> np.ndarray:
        """Return the best unknowns over several initial headings."""
        body, config = self.body, self.config
        free = np.clip(body.rest_pose, body.lower, body.upper)
        angles = [k * 2 * np.pi / config.n_headings for k in range(config.n_headings)]
        poses = [_place_root(body, free, self.target.mean(0), angle) for angle in angles]
        zeros = np.zeros(len(self.groups))
        tried = [self._solution(np.concatenate([p, zeros]), config.n_trial) for p in poses]
        best = min(tried, key=lambda solution: solution.cost)
        return self._solution(best.x, None).x

    def _solution(self, start: np.ndarray, max_evaluations: int | None) -> Any:
        size = np.full(len(self.groups), self.config.max_log_scale)
        lower = np.concatenate([self.body.lower, -size])
        upper = np.concatenate([self.body.upper, size])
        inside = np.clip(start, lower + 1e-9, upper - 1e-9)
        return least_squares(
            self.residuals, inside, self.jacobian, bounds=(lower, upper), max_nfev=max_evaluations
        )


def _select_given_joints(
    body: BodyModel, joints: Mapping[str, np.ndarray], config: JointFitConfig
) -> list[str]:
    """Return the body's joints that are given. Raises InputError if there are too few."""
    least = min(config.min_joints, len(body.joints))
    names = [n for n in body.joint_names if n in joints and np.isfinite(joints[n]).all()]
    if len(names) < least:
        raise InputError(
            f"{len(names)} known joints to start from ({join_names(names)}); "
            f"expected at least {least} of: {', '.join(body.joint_names)}"
        )
    return names


def _place_root(
    body: BodyModel, pose: np.ndarray, centre: np.ndarray, heading: float
) -> np.ndarray:
    """Return `pose`, moved so that the mean of its joints is `centre`, and turned by `heading`
    about z."""
    pose = pose.copy()
    root = {axis.kind: axis for axis in body.bones[0].axes}
    if "rz" in root:
        pose[root["rz"].dof] += heading
    offset = centre - posed_joints(body, pose[None])[0].mean(0)
    for kind, value in zip(("tx", "ty", "tz"), offset, strict=True):
        if kind in root:
            pose[root[kind].dof] += root[kind].sign * value
    return pose
