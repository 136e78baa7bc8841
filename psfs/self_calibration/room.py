"""Edges of the empty room as measurements of the cameras' rotations.

Edges of walls, doors, cupboards and floor boards are parallel to a few directions, the vertical and
some horizontal ones, which all cameras see (vanishing points: Barnard, Artificial Intelligence 21,
1983; Kosecka & Zhang, ECCV 2002). An edge measures how far its ends are from the line through its
middle towards the vanishing point. The directions are eliminated from the normal equations, so
walls need not stand square. Silhouettes hardly tell a rig whose cameras are all turned a little
towards one side from a person who stands there; edges do not depend on the person.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.diagnostics.refinement import N_PARAMETERS
from psfs.self_calibration.config import PersonConfig, RoomConfig
from psfs.self_calibration.verticals import fit_vertical

#: Width of Geman & McClure's weights, in standard deviations of the residuals.
_REACH = 2.5
#: Steps by which directions are adjusted to given cameras.
_STEPS = 3


@dataclass(frozen=True, eq=False)
class _Lines:
    """M edges. views: (M,). normals: (M, 3) of their planes, in the cameras' axes. middles: (M, 2)
    at depth 1. halves: (M,) half of their lengths, px."""

    views: np.ndarray
    normals: np.ndarray
    middles: np.ndarray
    halves: np.ndarray

    @classmethod
    def create(cls, cameras: Sequence[Camera], edges: Sequence[np.ndarray]) -> _Lines:
        """Return the edges [view] (N, 2, 2) px without the lens's distortion."""
        ends = [
            camera.normalise(own.reshape(-1, 2)).reshape(-1, 2, 2)
            for camera, own in zip(cameras, edges, strict=True)
        ]
        views = np.repeat(np.arange(len(ends)), [len(own) for own in ends])
        both = np.concatenate(ends)
        sound = np.isfinite(both).all(axis=(1, 2))  # else beyond what the lens shows
        views, both = views[sound], both[sound]
        along, middles = both[:, 1] - both[:, 0], both.mean(axis=1)
        lengths = np.linalg.norm(along, axis=1)
        x, y = (along / lengths[:, None]).T
        normals = np.stack([-y, x, middles[:, 0] * y - middles[:, 1] * x], -1)
        focal = np.array([camera.K[0, 0] for camera in cameras])[views]
        return cls(views, normals, middles, 0.5 * focal * lengths)

    def measure(
        self, cameras: Sequence[Camera], directions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return residuals (M, K) px for directions (K, 3), these in the cameras' axes (M, K, 3),
        and px (M, K) per unit of the product of normal and direction."""
        R = np.stack([camera.R for camera in cameras])[self.views]
        local = np.einsum("mij,kj->mki", R, directions)
        towards = local[..., :2] - self.middles[:, None] * local[..., 2:]
        scales = self.halves[:, None] / np.maximum(np.linalg.norm(towards, axis=-1), 1e-6)
        return scales * np.einsum("mi,mki->mk", self.normals, local), local, scales


class RoomEdges:
    """Measurements of a rig's rotations by edges [view] (N, 2, 2) px that are parallel to
    `directions` (K, 3)."""

    def __init__(
        self, edges: Sequence[np.ndarray], directions: np.ndarray, config: RoomConfig
    ) -> None:
        self._edges, self._directions, self.config = edges, directions, config

    def __call__(
        self, cameras: Sequence[Camera], offsets: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the normal matrix (8 V, 8 V) and the gradient (8 V,) at cameras."""
        lines, directions = _Lines.create(cameras, self._edges), self._directions
        size, count = len(cameras) * N_PARAMETERS, 2 * len(directions)
        for _ in range(_STEPS):
            normal, gradient, axes = self._differentiate(lines, cameras, directions)
            own = normal[size:, size:] + 1e-9 * np.eye(count)
            step = -np.linalg.solve(own, gradient[size:]).reshape(-1, 2)
            directions = directions + np.einsum("ki,kij->kj", step, axes)
            directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        normal, gradient, _ = self._differentiate(lines, cameras, directions)
        mixed, own = normal[:size, size:], normal[size:, size:] + 1e-9 * np.eye(count)
        solved = np.linalg.solve(own, mixed.T)
        return normal[:size, :size] - mixed @ solved, gradient[:size] - solved.T @ gradient[size:]

    def _differentiate(
        self, lines: _Lines, cameras: Sequence[Camera], directions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the normal matrix and the gradient by cameras and directions, and the axes
        (K, 2, 3) along which directions move."""
        residuals, local, scales = lines.measure(cameras, directions)
        rows, nearest = np.arange(len(residuals)), np.abs(residuals).argmin(axis=1)
        values, local, scales = (of[rows, nearest] for of in (residuals, local, scales))
        near = np.abs(values) < self.config.gate
        noise = np.full(len(rows), self.config.noise)
        for number in range(len(directions)):  # edges that are parallel by chance are less so
            own = near & (nearest == number)
            if own.any():
                noise[own] = max(self.config.noise, 1.4826 * np.median(np.abs(values[own])))
        roots = np.sqrt(self.config.information * near)
        roots = roots / (noise * (1 + (values / (_REACH * noise)) ** 2))
        axes: np.ndarray = np.linalg.svd(directions[:, None])[2][:, 1:]
        jacobian = np.zeros((len(rows), len(cameras) + len(axes), N_PARAMETERS))
        by_turn = np.cross(local, lines.normals)
        jacobian[rows, lines.views, :3] = scales[:, None] * by_turn
        jacobian[rows, lines.views, 6] = -scales * lines.normals[:, 2] * local[:, 2]
        R = np.stack([camera.R for camera in cameras])[lines.views]
        by_direction = np.einsum("mij,mi,mkj->mk", R, lines.normals, axes[nearest])
        jacobian[rows, len(cameras) + nearest, :2] = scales[:, None] * by_direction
        kept = [*range(len(cameras) * N_PARAMETERS)]
        kept += [(len(cameras) + k) * N_PARAMETERS + i for k in range(len(axes)) for i in (0, 1)]
        weighted = (roots[:, None, None] * jacobian).reshape(len(rows), -1)[:, kept]
        return weighted.T @ weighted, weighted.T @ (roots * values), axes


def find_room_edges(
    rig: CameraRig, edges: Sequence[np.ndarray], up: np.ndarray, config: PersonConfig
) -> RoomEdges | None:
    """Return the measurements by edges [view] (N, 2, 2) px of a rig whose up is near `up` (3,);
    None if vertical edges are not clear."""
    vertical = fit_vertical(rig, edges, up, config.verticals)
    if vertical is None:
        return None
    lines, room = _Lines.create(rig.cameras, edges), config.room
    axes = np.linalg.svd(vertical[None])[2][1:]
    angles = np.arange(0, np.pi, room.step)
    tried = np.column_stack([np.cos(angles), np.sin(angles)]) @ axes
    residuals = lines.measure(rig.cameras, tried)[0]
    weights = np.minimum(lines.halves, room.longest)[:, None]
    shares = weights / (1 + (residuals / room.width) ** 2) ** 2
    free = np.abs(lines.measure(rig.cameras, vertical[None])[0][:, 0]) > room.width
    found = [vertical]
    for _ in range(room.horizontal):
        scores = shares[free].sum(axis=0)
        best = int(scores.argmax())
        if scores[best] < room.clear * np.median(scores):
            break
        found.append(tried[best])
        free &= np.abs(residuals[:, best]) > 2 * room.width
    return RoomEdges(edges, np.array(found), room)
