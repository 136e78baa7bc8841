"""Fit the first pose to 3-D joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from apf.body.jacobian import bone_point_jacobian
from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.body.schema import TALLEST
from apf.formats.pose import FARTHEST
from apf.initialisation.fit_config import JointFitConfig
from cl import InputError
from psfs.cameras.names import join_names
from psfs.common.least_squares import Parameters, Residuals, Slope, prior, solve

#: Step of the forward differences of the log of a scale: about the square root of float64's
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
    scales, pose = fit.solve()
    scaled = body.scaled(scales)
    offset = posed_joints(scaled, pose[None])[0, fit.chosen] - target
    error = float(np.sqrt(np.mean(np.sum(offset**2, -1))))
    girth = float(np.mean(list(scales.values())))
    return body.scaled(scales, radii=girth), pose, error


class _JointFit:
    """The least-squares problem of `fit_to_joints`: a pose, and the log of a scale for each group
    of bones. chosen: indices of the joints at `target` (J, 3) m."""

    def __init__(
        self, body: BodyModel, chosen: list[int], target: np.ndarray, config: JointFitConfig
    ) -> None:
        self.body, self.chosen, self.target, self.config = body, chosen, target, config
        self._bones = replace(body, cones=())  # joints do not depend on the cones
        self._on = np.array([body.joints[index].bone for index in chosen])
        self._spread = np.full(body.n_dof, np.inf)
        self._spread[body.angles] = config.angle

    def scales(self, sizes: np.ndarray) -> dict[str, float]:
        """Return the scale of each group, of their logs (G,)."""
        return dict(zip(self.body.scale_groups, np.exp(sizes), strict=True))

    def joints(self, sizes: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Return the chosen joints (J, 3) m of a pose (D,)."""
        scaled = self._bones.scaled(self.scales(sizes))
        return posed_joints(scaled, pose[None])[0, self.chosen]

    def solve(self) -> tuple[dict[str, float], np.ndarray]:
        """Return the scales and the pose (D,) that fit best over several initial headings."""
        body, config = self.body, self.config
        free = np.clip(body.rest_pose, body.lower, body.upper)
        angles = [k * 2 * np.pi / config.n_headings for k in range(config.n_headings)]
        starts = [
            {
                "pose": _place_root(body, free, self.target.mean(0), angle)[None],
                "sizes": np.zeros((1, len(body.scale_groups))),
            }
            for angle in angles
        ]
        tried = [
            solve(self._evaluate, at, steps=config.n_trial, update=self._move) for at in starts
        ]
        best = min(tried, key=lambda solution: solution.cost).parameters
        found = solve(self._evaluate, best, update=self._move).parameters
        return self.scales(found["sizes"][0]), found["pose"][0]

    def _evaluate(self, at: Parameters) -> list[Residuals]:
        config, first = self.config, np.zeros(len(self.chosen), int)
        sizes, pose = at["sizes"][0], at["pose"][0]
        joints = self.joints(sizes, pose)
        scaled = self._bones.scaled(self.scales(sizes))
        by_pose = bone_point_jacobian(scaled, pose[None], self._on, joints[None])[0]
        moved = [self.joints(sizes + step, pose) for step in _STEP * np.eye(len(sizes))]
        by_size = (np.stack(moved, -1) - joints[..., None]) / _STEP
        slopes = [Slope("pose", first, by_pose.swapaxes(1, 2)), Slope("sizes", first, by_size)]
        return [
            Residuals(joints - self.target, slopes, sigma=config.joint, robust=False),
            prior("sizes", at["sizes"], config.scale),
            prior("pose", at["pose"], self._spread, self.body.rest_pose),
        ]

    def _move(self, at: Parameters, step: Parameters) -> Parameters:
        """Return the parameters after a step, within the limits of the body and of its scales."""
        most = self.config.max_log_scale
        return {
            "pose": np.clip(at["pose"] + step["pose"], self.body.lower, self.body.upper),
            "sizes": np.clip(at["sizes"] + step["sizes"], -most, most),
        }


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
