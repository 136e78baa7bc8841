"""Up, and the cameras' rotations, from straight edges of the empty room.

Edges of walls, doors, cupboards and floor boards are parallel to a few directions, the vertical and
some horizontal ones, which all cameras see (vanishing points: Barnard, Artificial Intelligence 21,
1983; Kosecka & Zhang, ECCV 2002). An edge measures how far its ends are from the line through its
middle towards the vanishing point. Edges are line segments (von Gioi et al., PAMI 32, 2010).
Silhouettes hardly tell a rig whose cameras are all turned a little towards one side from a person
who stands there; edges do not depend on the person. Walls need not stand square.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import cv2
import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.common.least_squares import Parameters, Residuals, Slope, estimate_noise, solve
from psfs.diagnostics.refinement import N_PARAMETERS, Further

#: Shortest edge, as a share of the picture's longest side; half length from which on edges count
#: alike, px.
_SHORTEST, _LONGEST = 0.03, 60.0
#: Distance of an edge's ends at which it has a quarter of its weight, px, its greatest, and its
#: least noise.
_WIDTH, _GATE, _NOISE = 1.5, 4.0, 0.15
#: Greatest angle of up from the person's, step of the directions that are tried, and angle from
#: which on a direction is another one, rad.
_AROUND, _STEP, _APART = 0.21, 0.0087, 0.044
#: Multiple of the weight of other directions that up needs: 1.6 to 5 of true rigs, up to 1.4 of
#: rigs with pictures exchanged; and of the median direction's weight that a wall needs.
_CLEAR, _WALL = 1.5, 2.0
#: Independent measurements per edge; more than one, for silhouettes are wrong alike.
_INFORMATION = 8.0


def find_edges(picture: np.ndarray) -> np.ndarray:
    """Return the ends (N, 2, 2) px of the straight edges in a picture (h, w, 3) uint8."""
    segments = cv2.createLineSegmentDetector().detect(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY))[0]
    ends = np.zeros((0, 2, 2)) if segments is None else segments.reshape(-1, 2, 2).astype(float)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return ends[lengths > _SHORTEST * max(picture.shape[:2])]


def fit_vertical(rig: CameraRig, edges: Sequence[np.ndarray], up: np.ndarray) -> np.ndarray | None:
    """Return the direction (3,) near `up` (3,) in which the room's edges [view] (N, 2, 2) px are
    vertical; None if another direction fits nearly as many."""
    lines = _Lines(rig.cameras, edges)
    if len(lines.views) < 2:
        return None
    steps = np.arange(-_AROUND, _AROUND + _STEP, _STEP)
    turns = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    axes = np.linalg.svd(up[None])[2]
    tried = axes[0] * np.sign(axes[0] @ up) + np.tan(turns) @ axes[1:]
    tried = tried[np.linalg.norm(turns, axis=1) <= _AROUND]
    tried /= np.linalg.norm(tried, axis=1, keepdims=True)
    scores = lines.score(rig.cameras, tried).sum(axis=0)
    best = tried[scores.argmax()]
    others = scores[tried @ best < np.cos(_APART)]
    if scores.max() < _CLEAR * others.max(initial=0):
        return None
    (fitted,) = RoomEdges(edges, best[None]).fit_directions(rig.cameras)
    return fitted * np.sign(fitted @ best)


def find_room_edges(
    rig: CameraRig, edges: Sequence[np.ndarray], up: np.ndarray
) -> RoomEdges | None:
    """Return the measurements by edges [view] (N, 2, 2) px of a rig whose up is near `up` (3,);
    None if vertical edges are not clear."""
    vertical = fit_vertical(rig, edges, up)
    if vertical is None:
        return None
    lines = _Lines(rig.cameras, edges)
    axes = np.linalg.svd(vertical[None])[2][1:]
    angles = np.arange(0, np.pi, _STEP)
    tried = np.column_stack([np.cos(angles), np.sin(angles)]) @ axes
    residuals = np.abs(lines.measure(rig.cameras, tried)[0])
    shares = lines.score(rig.cameras, tried)
    free = np.abs(lines.measure(rig.cameras, vertical[None])[0][:, 0]) > _WIDTH
    directions = [vertical]
    for _ in range(2):  # walls
        scores = shares[free].sum(axis=0)
        best = int(scores.argmax())
        if scores[best] < _WALL * np.median(scores):
            break
        directions.append(tried[best])
        free &= residuals[:, best] > 2 * _WIDTH
    return RoomEdges(edges, np.array(directions))


class _Lines:
    """M edges, those [view] (N, 2, 2) px without the lens's distortion.

    views: (M,). normals: (M, 3) of their planes, in the cameras' axes. middles: (M, 2) at depth 1.
    halves: (M,) half of their lengths, px.
    """

    def __init__(self, cameras: Sequence[Camera], edges: Sequence[np.ndarray]) -> None:
        ends = [
            camera.normalise(view_edges.reshape(-1, 2)).reshape(-1, 2, 2)
            for camera, view_edges in zip(cameras, edges, strict=True)
        ]
        views = np.repeat(np.arange(len(ends)), [len(view_edges) for view_edges in ends])
        both = np.concatenate(ends)
        sound = np.isfinite(both).all(axis=(1, 2))  # else beyond what the lens shows
        self.views, both = views[sound], both[sound]
        along, self.middles = both[:, 1] - both[:, 0], both.mean(axis=1)
        lengths = np.linalg.norm(along, axis=1)
        x, y = (along / lengths[:, None]).T
        self.normals = np.stack([-y, x, self.middles[:, 0] * y - self.middles[:, 1] * x], -1)
        focal = np.array([camera.K[0, 0] for camera in cameras])[self.views]
        self.halves = 0.5 * focal * lengths

    def measure(
        self, cameras: Sequence[Camera], directions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return residuals (M, K) px for directions (K, 3), these in the cameras' axes (M, K, 3),
        and px (M, K) per unit of the product of normal and direction."""
        local = np.stack([directions @ camera.R.T for camera in cameras])[self.views]
        towards = local[..., :2] - self.middles[:, None] * local[..., 2:]
        scales = self.halves[:, None] / np.maximum(np.linalg.norm(towards, axis=-1), 1e-6)
        return scales * np.einsum("mi,mki->mk", self.normals, local), local, scales

    def score(self, cameras: Sequence[Camera], directions: np.ndarray) -> np.ndarray:
        """Return how much each edge speaks for each direction, (M, K), px."""
        residuals = self.measure(cameras, directions)[0]
        halves = np.minimum(self.halves, _LONGEST)[:, None]
        return halves / (1 + (residuals / _WIDTH) ** 2) ** 2


class RoomEdges:
    """Measurements of a rig's rotations by edges [view] (N, 2, 2) px that are parallel to
    `directions` (K, 3)."""

    def __init__(self, edges: Sequence[np.ndarray], directions: np.ndarray) -> None:
        self._edges, self._directions = edges, directions
        self._axes = np.linalg.svd(directions[:, None])[2][:, 1:]  # along which these move

    def bind(self) -> Further:
        """Return the measurements for `fit_rig`, with steps of the directions."""
        steps = {"directions": np.zeros((len(self._directions), 2))}
        return Further(steps, lambda cameras, _, parameters: self._measure(cameras, parameters))

    def fit_directions(self, cameras: Sequence[Camera]) -> np.ndarray:
        """Return the directions (K, 3) to which the edges are parallel in cameras."""
        held = np.zeros((len(cameras), N_PARAMETERS))
        start = {"cameras": held, **self.bind().start}
        measure = partial(self._measure, cameras)
        return self._move(solve(measure, start, steps=4, free={"cameras": held > 0}).parameters)

    def _move(self, parameters: Parameters) -> np.ndarray:
        steps = np.einsum("ki,kij->kj", parameters["directions"], self._axes)
        moved = self._directions + steps
        return np.asarray(moved / np.linalg.norm(moved, axis=1, keepdims=True))

    def _measure(self, cameras: Sequence[Camera], parameters: Parameters) -> list[Residuals]:
        """Return the residuals, px, of the edges to the nearest direction. Edges that are parallel
        by chance are less so: the noise is estimated for each direction."""
        lines = _Lines(cameras, self._edges)
        residuals, local, scales = lines.measure(cameras, self._move(parameters))
        nearest = np.abs(residuals).argmin(axis=1)
        rows = np.arange(len(residuals))
        values, local, scales = (v[rows, nearest] for v in (residuals, local, scales))
        by_camera = np.zeros((len(rows), 1, N_PARAMETERS))
        by_camera[:, 0, :3] = scales[:, None] * np.cross(local, lines.normals)
        by_camera[:, 0, 6] = -scales * lines.normals[:, 2] * local[:, 2]
        R = np.stack([camera.R for camera in cameras])[lines.views]
        by_direction = np.einsum("m,mij,mi,mkj->mk", scales, R, lines.normals, self._axes[nearest])
        slopes = [
            Slope("cameras", lines.views, by_camera),
            Slope("directions", nearest, by_direction[:, None]),
        ]
        values, noise = np.where(np.abs(values) < _GATE, values, np.nan), np.full(len(rows), _NOISE)
        for number in np.unique(nearest):
            mine = nearest == number
            noise[mine] = estimate_noise(values[mine], least=_NOISE)
        return [Residuals(values, slopes, noise, _INFORMATION)]
