"""Courses of walkers: of several people who do not meet in one room, with the frames in which each
is there; and of any body, every angle of which swings as fast as its `sigma` says, left and right
in turn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from apf.body.kinematics import posed_cones, posed_joints
from apf.body.limbs import limb_bones
from apf.body.model import BodyModel, find_side, sideless
from apf.body.stature import lowest_point
from apf.synthetic.body import HAIR, PRIMITIVE_FLOATS, SHIRT, SHOE, SKIN, TROUSERS, pack_constants
from apf.synthetic.config import SceneConfig
from apf.synthetic.walk import Path, Walk

#: Mean distances, m, of the two courses from the middle of the room; people on one walk against
#: those on the other.
_OUTER, _INNER = 1.45, 0.7
_WOBBLE = 0.05
#: Least and greatest stature of everybody but the first person, m.
_STATURE = (1.55, 1.90)
#: Speed on the inner course, as a share of that on the outer one.
_INNER_PACE = 0.75


def make_walks(config: SceneConfig) -> list[Walk]:
    """Return a walk for each person: alone as `SceneConfig.walk` is; of several every second one on
    the outer course, the others on the inner one, evenly spaced."""
    if config.people == 1:
        return [config.walk]
    walks = []
    for number in range(config.people):
        rng = np.random.default_rng([config.seed, 6, number])
        height = config.height if number == 0 else rng.uniform(*_STATURE)
        outer = number % 2 == 0
        on_course = (config.people + outer) // 2
        turn = 2 * np.pi * (number // 2 / on_course) + config.seed
        radius = _OUTER if outer else _INNER
        walk = Walk.sample(int(rng.integers(2**31)), height)
        pace = 1.0 if outer else _INNER_PACE
        # All on one course walk at one speed, and so stay apart.
        walk = replace(walk, speed=1.15 * pace, stride=walk.stride * pace, radius=radius)
        walks.append(replace(walk, wobble=_WOBBLE, turn=turn, clockwise=not outer, heading=None))
    return walks


def presence(config: SceneConfig) -> np.ndarray:
    """Return when each person is there, (P, F) bool: always, except that a visitor, the last
    person, comes after a third of the frames, leaves after two thirds, and comes back for the last
    sixth."""
    there = np.ones((config.people, config.frames), bool)
    if config.visitor:
        share = np.arange(config.frames) / config.frames
        there[-1] = ((share >= 1 / 3) & (share < 2 / 3)) | (share >= 5 / 6)
    return there


#: Steps per second and the rate, frames/s, that `sigma` refers to.
_PACE, _RATE = 0.9, 60.0
#: Share of the speeds that `sigma` allows.
_SPEED = 0.6
#: Regions of the limbs in turn, and distance, m, over which cones blend.
_LIMBS, _BLEND = (TROUSERS, SKIN, SHOE, HAIR), 0.02


def roam(body: BodyModel, walk: Walk, times: np.ndarray, seed: int) -> np.ndarray:
    """Return poses (F, D) of `body` at `times` (F,) s: it goes along the course of `walk`, and its
    lowest point touches the floor."""
    rng = np.random.default_rng([seed, 8])
    turn = 2 * np.pi * _PACE
    poses = np.tile(body.rest_pose, (len(times), 1))
    phases: dict[tuple[str, str], float] = {}
    for bone in body.bones:
        for axis in bone.axes:
            if bone.parent < 0 and axis.kind in ("tx", "ty", "tz", "rz"):
                continue
            lower, upper = body.lower[axis.dof], body.upper[axis.dof]
            swing = _SPEED * body.sigma[axis.dof] * _RATE * np.sqrt(2) / turn
            swing = min(swing, (upper - lower) / 2)
            middle = np.clip(body.rest_pose[axis.dof], lower + swing, upper - swing)
            key = sideless(bone.name), axis.kind
            phase = phases.setdefault(key, rng.uniform(0, 2 * np.pi))
            phase += np.pi * (find_side(bone.name) == "right")
            poses[:, axis.dof] = middle + swing * np.sin(turn * times + phase)
    place, heading = Path(walk)(walk.speed * times)
    there = {"tx": place[:, 0], "ty": place[:, 1], "rz": heading}
    lift = next((axis.dof for axis in body.bones[0].axes if axis.kind == "tz"), None)
    for axis in body.bones[0].axes:
        if axis.kind in there:
            poses[:, axis.dof] = axis.sign * there[axis.kind]
    if lift is not None:
        poses[:, lift] -= [lowest_point(cones) for cones in posed_cones(body, poses)]
    return poses


class Roamer:
    """A body on its walk, as the renderer takes it. joints: (F, J, 3) m. poses: (F, D)."""

    def __init__(self, body: BodyModel, walk: Walk, times: np.ndarray, seed: int) -> None:
        self.body, self.poses = body, roam(body, walk, times, seed)
        trail = posed_joints(body, self.poses)[:, 0, :2]
        for axis in body.bones[0].axes[:2]:  # the walked part is centred on the origin
            if axis.kind in ("tx", "ty"):
                column = trail[:, "xy".index(axis.kind[1])]
                self.poses[:, axis.dof] -= axis.sign * (column.min() + column.max()) / 2
        self.joints, self.joint_names = posed_joints(body, self.poses), body.joint_names
        self._cones = posed_cones(body, self.poses)
        limbs, rows = limb_bones(body), []
        for number, cone in enumerate(body.cones):
            limb = int(np.argmax(limbs[:, cone.bone])) if limbs[:, cone.bone].any() else -1
            region = SHIRT if limb < 0 else _LIMBS[limb % len(_LIMBS)]
            rows.append((limb + 1, SKIN if cone.name == "head" else region, number))
        self._order = np.array(sorted(rows)).T  # group, region, cone; limbs do not blend
        rest = posed_cones(body, body.rest_pose[None])[0]
        along = rest[:, 4:7] - rest[:, 0:3]
        slopes = along[:, 2] / np.linalg.norm(along, axis=1)
        self._heights = np.stack([rest[:, 2], slopes])  # stripes stay on the cloth

    def posed(self, index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return primitives (C, PRIMITIVE_FLOATS), balls (S, 4) and the centre (2,) m of the shadow
        map, float32."""
        groups, regions, order = self._order
        cones = self._cones[index, order]
        packed = np.zeros((len(cones), PRIMITIVE_FLOATS))
        a, along = cones[:, 0:3], cones[:, 4:7] - cones[:, 0:3]
        length = np.linalg.norm(along, axis=1)
        rows = np.stack([cones[:, 8:11], cones[:, 12:15], along / length[:, None]], 1)
        packed[:, 0:9] = rows.reshape(-1, 9)
        packed[:, 9:12] = -np.einsum("pka,pa->pk", rows, a)
        squash = 1 / np.linalg.norm(rows[:, :2], axis=2)
        packed[:, 20:23] = a + along / 2
        pack_constants(packed, length, cones[:, [3, 7]], squash)
        packed[:, 18], packed[:, 19] = _BLEND, groups
        packed[:, 24], packed[:, 25], packed[:, 26] = regions, regions, 2 * length
        packed[:, 27], packed[:, 28] = self._heights[:, order]
        shares = np.linspace(0, 1, 4)[:, None, None]
        thin = np.minimum(squash.min(1), 1)[:, None]
        radii = thin * (cones[:, [3]] + shares * (cones[:, [7]] - cones[:, [3]]))
        balls = np.concatenate([a + shares * along, radii], axis=-1).reshape(-1, 4)
        return packed.astype(np.float32), balls.astype(np.float32), self.joints[index, 0, :2]
