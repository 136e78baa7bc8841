"""The global search in one frame: where a person stands, which way, how tall, in what pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from apf.backend import filter_for
from apf.body.cones import overlap_errors
from apf.body.kinematics import bone_matrices, posed_cones
from apf.body.model import BodyModel
from apf.filters.config import FilterConfig
from apf.initialisation.shape_fit import (
    Cloud,
    Shape,
    angular,
    contacts,
    fit_shape,
    stature,
    surface_places,
)
from apf.scene import Scene
from cl import Device, NumpyDevice
from psfs.cameras.camera import CameraRig
from psfs.voxels.grid import VoxelGrid

#: Headings that are tried, how many of the best go on, and how far these are apart, rad.
_HEADINGS, _KEPT, _APART = 8, 3, 0.8
#: Deviations of the search by kind of axis of the root, m and rad.
_ROOT = {"tx": 0.08, "ty": 0.08, "tz": 0.06, "rx": 0.15, "ry": 0.15, "rz": 0.35}
#: Those of the other angles: a share of what their limits span, at most so many rad; in the
#: search for a whole body, and for a limb.
_SPAN, _WIDEST = {"body": 0.2, "limb": 0.25}, {"body": 0.6, "limb": 0.8}
#: Bones that a limb hangs on.
_LIMBS = ("l_upper_arm", "r_upper_arm", "l_thigh", "r_thigh")
#: Hypotheses go on whose cost is at most so many times the least one.
_CLOSE = 1.2
#: Starts from which a limb is searched for.
_LIMB_STARTS = 4
#: Particles of the search for a whole body, for a limb, and near a pose.
_PARTICLES = {"body": 300, "limb": 150, "near": 100}
#: What a start goes by: hulls of few cameras are thicker than the person, and a body turned or bent
#: wrongly fills them as well; what it covers in the pictures, and their edges, tell more.
LIKELIHOOD = FilterConfig(
    surface_weight=1.0, two_sided_weight=2.0, sample_spacing=0.04, point_turns=4
)
#: What 1 % of misfit counts as, as a share of 1 % of error.
_VOXELS = 0.3
#: Distance, m, at which a point is half unexplained in a misfit.
_SCALE = 0.04
#: Unexplained share that counts as much as bending a joint by a quarter of its range, and as
#: parts wholly in each other.
_BEND, _OVERLAP = 0.003, 0.1
#: People look where they go: share that a cost grows by when they go backwards, and the way, m,
#: from which on that counts.
_BACKWARDS, _WAY = 0.25, 0.25


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A pose (D,) of the template scaled by `shape` (S,), its error by the likelihood, and its
    `misfit`."""

    shape: np.ndarray
    pose: np.ndarray
    error: float
    misfit: float

    @property
    def cost(self) -> float:
        """What hypotheses are compared by, the less the better."""
        return self.error * self.misfit**_VOXELS


class PoseSearch:
    """Searches single frames for a person of unknown size and pose: `search(voxels, cloud)`.

    way: (2,) m, by how much the person moves over the first frames.
    """

    def __init__(
        self,
        device: Device | NumpyDevice,
        rig: CameraRig,
        grid: VoxelGrid,
        template: BodyModel,
        height: float | None,
        keep_shape: bool,
        seed: int,
        way: np.ndarray,
    ) -> None:
        self.device, self.rig, self.grid = device, rig, grid
        self.template, self.height, self.way = template, height, way
        self.model = Shape(template)
        self.free = () if keep_shape else (0, 1)
        self.seed = seed
        self.random = np.random.default_rng(seed)
        self._near: tuple[np.ndarray, Any] | None = None  # a shape and its tracker

    def __call__(self, voxels: Any, cloud: Cloud) -> list[Hypothesis]:
        """The best hypotheses that look in different directions, best first.

        voxels: what a tracker observes; cloud: the person's points among them.
        """
        shape = np.zeros(len(self.model.deviation))
        low, high = cloud.heights
        if self.free:
            shape[0] = np.log((self.height or high - low) / stature(self.template))
        body = self.model.body(shape)
        tracker = self._searcher(search_body(body), "body")
        found = []
        for heading in np.arange(_HEADINGS) * 2 * np.pi / _HEADINGS:
            pose, error = _searched(tracker, standing_pose(body, cloud, heading), voxels)
            found.append(Hypothesis(shape, pose, error, misfit(body, pose, cloud)))
        kept = [
            self._sized(voxels, cloud, hypothesis)
            for hypothesis in close(distinct(self.template, found, _KEPT + 1))
        ]
        ahead = [
            replace(h, error=h.error * sideways(self.template, h.pose[None], self.way))
            for h in kept
        ]
        return distinct(self.template, ahead, _KEPT)

    def with_limbs(self, voxels: Any, cloud: Cloud, hypothesis: Hypothesis) -> Hypothesis:
        """One limb after the other searched for again, anywhere within its limits."""
        body = self.model.body(hypothesis.shape)
        best = self.near(voxels, cloud, hypothesis.shape, hypothesis.pose)
        for limb in (bone.name for bone in body.bones if bone.name in _LIMBS):
            loose = search_body(body, limb)
            tracker = self._searcher(loose, "limb")
            found = [
                self.near(voxels, cloud, best.shape, _searched(tracker, start, voxels)[0])
                for start in self._limb_starts(best.pose, loose.sigma > 0)
            ]
            # Limbs in the air cost pictures little: where they are voxels know better.
            best = min([best, *found], key=lambda h: h.cost * h.misfit)
        return self._sized(voxels, cloud, best)

    def near(self, voxels: Any, cloud: Cloud, shape: np.ndarray, pose: np.ndarray) -> Hypothesis:
        """The best hypothesis of that shape near that pose."""
        if self._near is None or np.any(self._near[0] != shape):  # takes longer than a step
            config = replace(
                LIKELIHOOD, n_particles=_PARTICLES["near"], noise=0.1, trunk_layers=0,
                limb_spread=0.0, seed=self.seed,
            )  # fmt: skip
            body = self.model.body(shape)
            self._near = shape, filter_for(self._scene(body), config)
        tracker = self._near[1]
        pose, error = _searched(tracker, pose, voxels)
        return Hypothesis(shape, pose, error, misfit(tracker.body, pose, cloud))

    def _sized(self, voxels: Any, cloud: Cloud, hypothesis: Hypothesis) -> Hypothesis:
        """With the size and girth that bring the body onto the cloud, if that lowers the cost."""
        shape, poses = fit_shape(
            self.template, [cloud], hypothesis.shape, hypothesis.pose[None], self.height,
            steps=6, free=self.free,
        )  # fmt: skip
        other = self.near(voxels, cloud, shape, poses[0])
        return min(hypothesis, other, key=lambda h: h.cost)

    def _searcher(self, body: BodyModel, kind: str) -> Any:
        config = replace(
            LIKELIHOOD, n_particles=_PARTICLES[kind], noise=1.0, noise_decay=0.75, trunk_layers=0,
            seed=self.seed,
        )  # fmt: skip
        return filter_for(self._scene(body), config)

    def _scene(self, body: BodyModel) -> Scene:
        return Scene(self.device, self.rig, self.grid, body)

    def _limb_starts(self, pose: np.ndarray, moving: np.ndarray) -> list[np.ndarray]:
        """Poses whose `moving` part is as it was, at rest, and anywhere else."""
        rest = self.template.rest_pose
        starts = [pose, np.where(moving, rest, pose)]
        while len(starts) < _LIMB_STARTS:
            anywhere = self.random.uniform(self.template.lower[moving], self.template.upper[moving])
            start = pose.copy()
            start[moving] = (rest[moving] + anywhere) / 2
            starts.append(start)
        return starts


def _searched(tracker: Any, start: np.ndarray, voxels: Any) -> tuple[np.ndarray, float]:
    """The pose (D,) that `tracker` finds from `start`, and the error of its best particle."""
    tracker.start(start)
    estimate = tracker.step(voxels)
    return estimate.pose, float(estimate.least_error[-1])


def search_body(body: BodyModel, limb: str | None = None) -> BodyModel:
    """`body` with the deviations of a search that knows no pose; of one limb (`l_thigh`: what
    hangs on that bone), or of everything."""
    kind = "body" if limb is None else "limb"
    moving = {limb}
    sigma = np.zeros(body.n_dof)
    for bone in body.bones:
        root = bone.parent < 0
        if not root and body.bones[bone.parent].name in moving:
            moving.add(bone.name)
        for axis in bone.axes:
            if limb is None or bone.name in moving:
                span = body.upper[axis.dof] - body.lower[axis.dof]
                wide = min(_WIDEST[kind], _SPAN[kind] * span)
                sigma[axis.dof] = _ROOT[axis.kind] if root else wide
    return replace(body, sigma=sigma)


def standing_pose(body: BodyModel, cloud: Cloud, heading: float) -> np.ndarray:
    """The rest pose (D,) on the cloud: feet at the lowest, the trunk amid the middle."""
    points, (low, high) = cloud.tree.data, cloud.heights
    share = (points[:, 2] - low) / (high - low)
    middle = points[(share > 0.5) & (share < 0.75)].mean(0)
    pose = body.rest_pose.copy()
    cones = posed_cones(body, pose[None])[0]
    lowest = min((cones[:, 2] - cones[:, 3]).min(), (cones[:, 6] - cones[:, 7]).min())
    root = {axis.kind: axis for axis in body.bones[0].axes}
    for kind, value in (("tx", middle[0]), ("ty", middle[1]), ("rz", heading)):
        pose[root[kind].dof] = root[kind].sign * value
    pose[root["tz"].dof] += root["tz"].sign * (low - lowest)
    return pose


def misfit(body: BodyModel, pose: np.ndarray, cloud: Cloud) -> float:
    """Share of the cloud, and of the body's surface, that the other leaves unexplained (0 to 1);
    more for parts that lie in each other and for contortions."""
    cones = posed_cones(body, pose[None])[0]
    found = contacts(cloud, cones, surface_places(body), _SCALE)
    # The weights are share / (1 + u)^2 with u = gap^2 / scale^2; unexplained is u / (1 + u).
    unexplained = np.sum(found.share * (1 - np.sqrt(found.weight / found.share))) / 2
    inner = angular(body)
    range_ = (body.upper - body.lower)[inner]
    bends = np.sum(((pose - body.rest_pose)[inner] / (range_ / 4)) ** 2)
    overlap = overlap_errors(cones[None], body.apart)[0]
    return float(unexplained + _BEND * bends + _OVERLAP * overlap)


def distinct(template: BodyModel, hypotheses: Sequence[Hypothesis], n: int) -> list[Hypothesis]:
    """The best `n` hypotheses, best first, that look more than `_APART` away from each other."""
    kept: list[Hypothesis] = []
    for hypothesis in sorted(hypotheses, key=lambda h: h.cost):
        ahead = forward(template, hypothesis.pose)
        if all(ahead @ forward(template, other.pose) < np.cos(_APART) for other in kept):
            kept.append(hypothesis)
    return kept[:n]


def close(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Those whose cost is at most `_CLOSE` times the least one."""
    least = min(h.cost for h in hypotheses)
    return [h for h in hypotheses if h.cost <= _CLOSE * least]


def forward(body: BodyModel, pose: np.ndarray) -> np.ndarray:
    """(2,) horizontal direction, of length 1, in which the root's x axis points."""
    direction = bone_matrices(body, pose[None])[0][0, 0, :2, 0]
    return direction / np.linalg.norm(direction)


def sideways(body: BodyModel, poses: np.ndarray, way: np.ndarray) -> float:
    """Factor of the cost of poses (M, D) of a person who moves by `way` (2,) m: people look where
    they go; 1 where they do or hardly move, up to 1 + `_BACKWARDS` where they go backwards."""
    length = float(np.linalg.norm(way))
    if length < _WAY:
        return 1.0
    ahead = np.mean([forward(body, pose) for pose in poses], 0) @ way / length
    return 1 + _BACKWARDS * (1 - float(ahead)) / 2
