"""Hypotheses of a start, and their comparison."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from apf.body.cones import overlap_errors
from apf.body.kinematics import bone_matrices, posed_cones
from apf.body.model import BodyModel
from apf.body.stature import has_feet, lowest_point
from apf.initialisation.config import (
    CostConfig,
    HeadingConfig,
    PoseSearchConfig,
    ShapeFitConfig,
    SpreadConfig,
)
from apf.initialisation.shape_fit import Cloud, find_contacts
from apf.initialisation.shape_model import inner_axes, surface_samples


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A pose (D,) of the template scaled by `shape` (S,), its likelihood error, its
    `registration_error`, and the cost by which hypotheses are compared; lower is better."""

    shape: np.ndarray
    pose: np.ndarray
    error: float
    registration_error: float
    cost: float


def registration_error(
    body: BodyModel,
    pose: np.ndarray,
    cloud: Cloud,
    config: CostConfig | None = None,
    fit: ShapeFitConfig | None = None,
) -> float:
    """Return the share (0 to 1) of the cloud and of the body's surface that the other does not
    explain; higher for parts that intersect and for contorted poses.

    Unlike the misfit of a likelihood, it needs no silhouettes, and expects the whole body to be
    visible.
    """
    config, fit = config or CostConfig(), fit or ShapeFitConfig()
    cones = posed_cones(body, pose[None])[0]
    found = find_contacts(cloud, cones, surface_samples(body, fit.spacing), config.surface_scale)
    # The weights are share / (1 + u)^2 with u = gap^2 / scale^2; unexplained is u / (1 + u).
    unexplained = np.sum(found.share * (1 - np.sqrt(found.weight / found.share))) / 2
    inner = inner_axes(body)
    range_ = (body.upper - body.lower)[inner]
    bends = np.sum(((pose - body.rest_pose)[inner] / (range_ * config.bend_range)) ** 2)
    overlap = overlap_errors(cones[None], body.apart)[0]
    return float(unexplained + config.bend * bends + config.overlap * overlap)


def standing_pose(
    body: BodyModel, cloud: Cloud, heading: float, config: PoseSearchConfig | None = None
) -> np.ndarray:
    """Return the rest pose (D,) on the cloud: the trunk in the middle of the cloud, the feet at its
    lowest point; for a body without feet the highest points coincide."""
    config = config or PoseSearchConfig()
    points, (low, high) = cloud.tree.data, cloud.heights
    share = (points[:, 2] - low) / (high - low)
    trunk = points[(share > config.trunk_low) & (share < config.trunk_high)]
    middle = (trunk if len(trunk) else points).mean(0)
    pose = body.rest_pose.copy()
    cones = posed_cones(body, pose[None])[0]
    rise = low - lowest_point(cones) if has_feet(body) else high - highest_point(cones)
    root = {axis.kind: axis for axis in body.bones[0].axes}
    for kind, value in (("tx", middle[0]), ("ty", middle[1]), ("rz", heading)):
        pose[root[kind].dof] = root[kind].sign * value
    pose[root["tz"].dof] += root["tz"].sign * rise
    return pose


def highest_point(cones: np.ndarray) -> float:
    """Return the z, m, of the highest point of posed cones (C, 16)."""
    return float(max((cones[:, 2] + cones[:, 3]).max(), (cones[:, 6] + cones[:, 7]).max()))


def search_body(
    body: BodyModel, limb: int | None = None, spread: SpreadConfig | None = None
) -> BodyModel:
    """Return `body` with the standard deviations of a search without a known pose: for all axes, or
    only for the bones of the limb whose upper bone is `limb`."""
    spread = spread or SpreadConfig()
    moving = {limb}
    sigma = np.zeros(body.n_dof)
    for index, bone in enumerate(body.bones):
        if bone.parent >= 0 and bone.parent in moving:
            moving.add(index)
        for axis in bone.axes:
            span = body.upper[axis.dof] - body.lower[axis.dof]
            if limb is None and bone.parent < 0:
                sigma[axis.dof] = spread.root(axis.kind)
            elif limb is None:
                sigma[axis.dof] = min(spread.body_max, spread.body_share * span)
            elif index in moving:
                sigma[axis.dof] = min(spread.limb_max, spread.limb_share * span)
    return replace(body, sigma=sigma)


def select_distinct(
    template: BodyModel, hypotheses: Sequence[Hypothesis], n: int, separation: float
) -> list[Hypothesis]:
    """Return the best `n` hypotheses, best first, whose headings differ by more than `separation`,
    rad."""
    kept: list[Hypothesis] = []
    for hypothesis in sorted(hypotheses, key=lambda h: h.cost):
        ahead = forward(template, hypothesis.pose)
        if all(ahead @ forward(template, other.pose) < np.cos(separation) for other in kept):
            kept.append(hypothesis)
    return kept[:n]


def select_close(hypotheses: Sequence[Hypothesis], max_ratio: float) -> list[Hypothesis]:
    """Return those whose cost is at most `max_ratio` times the lowest."""
    least = min(h.cost for h in hypotheses)
    return [h for h in hypotheses if h.cost <= max_ratio * least]


def forward(body: BodyModel, pose: np.ndarray) -> np.ndarray:
    """Return the (2,) horizontal direction, of length 1, in which the root's x axis points."""
    direction = bone_matrices(body, pose[None])[0][0, 0, :2, 0]
    return direction / np.linalg.norm(direction)


def walking_factor(
    body: BodyModel, poses: np.ndarray, way: np.ndarray, config: HeadingConfig | None = None
) -> float:
    """Return the cost factor of poses (M, D) of a person who moves by `way` (2,) m: 1 if the person
    faces the direction of motion or hardly moves, higher if they move sideways or backwards."""
    config = config or HeadingConfig()
    length = float(np.linalg.norm(way))
    if length < config.min_way:
        return 1.0
    ahead = np.mean([forward(body, pose) for pose in poses], 0) @ way / length
    return 1 + config.backwards_cost * (1 - float(ahead)) / 2
