"""Fit a person's own body to the outlines of many frames: joints where the parts turn.

Every point of a silhouette's outline is a ray that touches the body. The unknowns are the poses
and, shared by all frames, the body's measures: lengths, the places of joints in the flesh, ends and
radii of the cones, and how far the surface is from the cones. Gauss-Newton on the distances of the
rays from the nearest surface; poses are eliminated frame by frame (Schur complement, Triggs et al.
2000). Where the take does not show a measure, it stays where anatomy puts it, see `_SPREAD`.

The tracked poses only say where to begin: their errors are the same in all frames, so all frames
together count as one observation of them. Feet turn about ankles, see `add_ankles`, and their soles
do not go through the floor: without them, nothing would say how long the shanks are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import cv2
import numpy as np

from apf.body.jacobian import (
    bone_point_jacobian,
    cone_motions,
    cross_rows,
    world_axes,
)
from apf.body.kinematics import bone_matrices, cross, posed_cones, posed_joints
from apf.body.model import BodyModel, Bone, Cone, Joint, sideless
from apf.initialisation.shape_model import (
    SPREAD,
    end_displacements,
    place_points,
    shift_bones,
)
from psfs.cameras.camera import CameraRig
from psfs.common.least_squares import REACH, multiply_alike, robust_weights
from psfs.common.numbers import pick_evenly
from psfs.common.progress import map_in_threads
from psfs.common.regions import bounding_box

T = TypeVar("T")

#: Standard deviations of a person's measures around the tracked body; lengths as in a start. Joints
#: in the flesh, m: hinges are felt through the skin, within 10 mm; regressions from bony marks miss
#: the centres of balls by 15 to 25 mm (Leardini et al. 1999). By hand: ends of cones, m, logs of
#: their radii, and distance of the surface from them as a share of the radius; people are no cones,
#: and hulls are thicker than they.
_SPREAD = {
    "length": SPREAD["length"],
    **{"hinge": 0.01, "ball": 0.025, "end": 0.01, "radius": 0.15, "surface": 0.15},
}
#: Standard deviation, rad or m, around the tracked pose where there is no posture prior.
_FREE = 3.0
#: Accuracy, m, of a cone's outline, and number of neighbouring rays that share one error.
NOISE, SHARED = 0.02, 8.0
#: Most rays of a view, fewest rays of a frame, and most frames that inform the measures.
_RAYS, _LEAST, _FRAMES = 80, 40, 24
#: Rings along a cone between which the surface's distance from it is interpolated, harmonics about
#: its axis from the constant on, and coefficients, with two caps.
_RINGS = 3
_HARMONICS = 3
_COEFFICIENTS = _RINGS * (2 * _HARMONICS - 1) + 2
#: Accuracy, m, of the height of a sole above the floor, z = 0, and distance, m, that tracked soles
#: may lie below it: hulls are thicker than people.
_SOLE, FLOOR = 0.005, 0.1
#: Distances, m, at which a ray counts a quarter, from the first step to the last.
REACHES = np.geomspace(0.08, 0.03, 7)
#: Most frames that a thread works on at a time: fewer wait for Python's lock more often.
_TOGETHER = 16
#: Number of steps of poses whose body is known.
_STEPS = 6
#: Share of a pose's own normal matrix added to its diagonal (Levenberg 1944).
_DAMPING = 1e-3


@dataclass(frozen=True, eq=False)
class Outlines:
    """Rays (K, 3) float32 through the outlines of one frame's silhouettes, of length 1, the camera
    (K,) uint8 of each, and the centres (V, 3) m and the angle (V,) rad of a pixel of all
    cameras."""

    rays: np.ndarray
    views: np.ndarray
    centres: np.ndarray
    pixels: np.ndarray

    def __len__(self) -> int:
        return len(self.rays)


def find_outline_pixels(shown: np.ndarray, known: np.ndarray) -> list[np.ndarray]:
    """Return evenly chosen pixels (K, 2) of the outlines of silhouettes `shown` (V, H, W) bool of
    each view, without those at the border of a picture or beside what is not `known` (V, H, W)."""
    window, chosen = np.ones((3, 3), np.uint8), []
    for mask, inside in zip(shown, known, strict=True):
        rows, columns = bounding_box(mask) or (slice(0, 1), slice(0, 1))
        top, left = max(0, rows.start - 2), max(0, columns.start - 2)
        part = slice(top, rows.stop + 2), slice(left, columns.stop + 2)
        opened = cv2.morphologyEx(mask[part].view(np.uint8), cv2.MORPH_OPEN, window)
        lines, _ = cv2.findContours(opened, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        pixels = np.concatenate([np.zeros((0, 2), int), *(line[:, 0] for line in lines)])
        beyond = cv2.erode(
            inside[part].view(np.uint8), window, borderType=cv2.BORDER_CONSTANT, borderValue=0
        )
        pixels = pixels[beyond[pixels[:, 1], pixels[:, 0]] > 0]
        chosen.append(pixels[pick_evenly(len(pixels), _RAYS)] + (left, top))
    return chosen


def find_outlines(rig: CameraRig, pixels: Sequence[Sequence[np.ndarray]]) -> list[Outlines]:
    """Return the outlines of frames whose `pixels` (K, 2) of each view are given, see
    `find_outline_pixels`."""
    if not pixels:
        return []
    by_view = []
    for camera, frames in zip(rig, zip(*pixels, strict=True), strict=True):
        through = camera.rays(np.concatenate(frames).astype(float))
        through /= np.linalg.norm(through, axis=1)[:, None]
        by_view.append(np.split(through, np.cumsum([len(of) for of in frames])[:-1]))
    outlines, angles = [], 1 / np.array([camera.K[0, 0] for camera in rig])
    for frame in zip(*by_view, strict=True):
        rays, views = np.concatenate(frame), np.repeat(np.arange(len(rig)), [*map(len, frame)])
        finite = np.isfinite(rays).all(1)
        outlines.append(
            Outlines(
                rays[finite].astype(np.float32), views[finite].astype(np.uint8), rig.centres, angles
            )
        )
    return outlines


class PersonalShape:
    """Measures (S,) of a person, 0 for the template's: logs of lengths, displacements of joints and
    of cones' ends in the frames of their bones, logs of radii, and coefficients of the surface's
    distance from the cones. Left mirrors right.

    spread: (S,) standard deviations. index: the number of each measure, by its kind, the name of
    its part, the end and the axis; of a surface, the number of its coefficient; a disc's
    ends share theirs. n_built: number of measures that the body is built of, those before the
    surface's.
    """

    def __init__(self, template: BodyModel) -> None:
        self.template = template
        bones = [bone for bone in template.bones if bone.parent >= 0]
        rows = [("length", group, 0, 0) for group in template.scale_groups]
        for name in dict.fromkeys(sideless(bone.name) for bone in bones):
            rows += [("joint", name, 0, axis) for axis in self._axes(name, bones)]
        balls = {
            sideless(bone.name) for bone in bones if sum(a.kind[0] == "r" for a in bone.axes) > 2
        }
        discs = {sideless(cone.name) for cone in template.cones if _is_disc(cone)}
        for name in template.radius_groups:
            for end in (0,) if name in discs else (0, 1):
                axes = self._axes(name, template.cones)
                rows += [("end", name, end, axis) for axis in axes]
                rows.append(("radius", name, end, 0))
        self.n_built = len(rows)
        for name in template.radius_groups:
            rows += [("surface", name, number, 0) for number in range(_COEFFICIENTS)]
        self.index = {row: number for number, row in enumerate(rows)}
        self.index |= {
            (kind, name, 1, axis): number
            for (kind, name, _, axis), number in self.index.items()
            if kind in ("end", "radius") and name in discs
        }
        kinds = [
            kind if kind != "joint" else "ball" if name in balls else "hinge"
            for kind, name, *_ in rows
        ]
        self.spread = np.array([_SPREAD[kind] for kind in kinds])
        radii = [
            np.mean([cone.radii for cone in template.cones if sideless(cone.name) == name])
            for name in template.radius_groups
        ]
        self.spread[self.n_built :] *= np.repeat(radii, _COEFFICIENTS) / np.sqrt(_HARMONICS)
        mirrors = [_mirror_cone(template, cone) for cone in template.cones]
        self._turns, self._swapped, self._share = map(np.array, zip(*mirrors, strict=True))
        #: (C,) the group of each cone, and (G, C) 1 for the cones of each group.
        self.group = np.array(
            [template.radius_groups.index(sideless(c.name)) for c in template.cones]
        )
        self.members = np.eye(len(template.radius_groups))[:, self.group]

    @staticmethod
    def _axes(name: str, parts: Sequence[Bone | Cone]) -> tuple[int, ...]:
        """Return the axes along which a part may move: those on the midline stay there."""
        on_midline = any(part.name == name for part in parts)
        return (0, 2) if on_midline else (0, 1, 2)

    def body(self, measures: np.ndarray) -> BodyModel:
        """Return the body with these measures (S,)."""
        template = self.template

        def value(kind: str, name: str, end: int = 0, axis: int = 0) -> float:
            row = self.index.get((kind, sideless(name), end, axis))
            return 0.0 if row is None else float(measures[row])

        def move(kind: str, name: str, end: int = 0) -> np.ndarray:
            moved = [value(kind, name, end, axis) for axis in range(3)]
            return np.array(moved) * _mirror(name)

        scaled = self._scale(measures)
        bones = [
            replace(bone, offset=bone.offset + move("joint", bone.name)) for bone in scaled.bones
        ]
        cones = [
            replace(
                cone,
                start=cone.start + move("end", cone.name),
                end=cone.end + move("end", cone.name, 1),
                radii=(
                    cone.radii[0] * np.exp(value("radius", cone.name)),
                    cone.radii[1] * np.exp(value("radius", cone.name, 1)),
                ),
            )
            for cone in scaled.cones
        ]
        joints = [
            replace(joint, position=joint.position + np.mean([move("joint", of) for of in pair], 0))
            if (pair := _pair_beside(template, joint)) else joint
            for joint in scaled.joints
        ]  # fmt: skip
        return replace(scaled, bones=tuple(bones), cones=tuple(cones), joints=tuple(joints))

    def _scale(self, measures: np.ndarray) -> BodyModel:
        """Return the template with the lengths of these measures (S,), which are the first."""
        groups = self.template.scale_groups
        return self.template.scaled(dict(zip(groups, np.exp(measures[: len(groups)]), strict=True)))

    def growths(self, measures: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Return the derivatives (M, n_built, C, 8) of the ends and radii of the cones by the
        measures that the body is built of, in poses (M, D)."""
        template, body = self.template, self.body(measures)
        cones = posed_cones(body, poses)[..., :8]
        rotations, _ = bone_matrices(body, poses)
        below = _descendants(template)[:, [cone.bone for cone in template.cones]]
        grown = np.zeros((len(poses), self.n_built, len(template.cones), 8))
        # Lengths come first. What is displaced on a bone does not grow with it.
        groups, scaled = template.scale_groups, self._scale(measures)
        on_bone = np.array(groups)[:, None] == [sideless(bone.name) for bone in template.bones]
        shifts = shift_bones(scaled, on_bone, rotations)
        for index, cone in enumerate(scaled.cones):
            for first, point in ((0, cone.start), (4, cone.end)):
                own = on_bone[:, cone.bone, None] * (rotations[:, cone.bone] @ point)[:, None]
                grown[:, : len(groups), index, first : first + 3] = shifts[:, :, cone.bone] + own
        for (kind, name, end, axis), number in self.index.items():
            here = slice(4 * end, 4 * end + 3)
            if kind == "joint":
                for index, bone in enumerate(template.bones):
                    if sideless(bone.name) == name:
                        along = rotations[:, bone.parent, :, axis] * _mirror(bone.name)[axis]
                        for first in (0, 4):
                            moving = np.flatnonzero(below[index])
                            grown[:, number, moving, first : first + 3] = along[:, None]
            elif kind in ("end", "radius"):
                for index, cone in enumerate(template.cones):
                    if sideless(cone.name) == name and kind == "end":
                        along = rotations[:, cone.bone, :, axis] * _mirror(cone.name)[axis]
                        grown[:, number, index, here] = along
                    elif sideless(cone.name) == name:
                        grown[:, number, index, here.stop] = cones[:, index, here.stop]
        return grown

    def move_joints(self, measures: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Return the derivatives (n_built, M, J, 3) of the joints by the measures that the body is
        built of, in poses (M, D)."""
        step, joints = 1e-4, posed_joints(self.body(measures), poses)
        moved = np.zeros((self.n_built, *joints.shape))
        for (kind, *_), number in self.index.items():
            if kind in ("length", "joint"):
                other = self.body(measures + step * np.eye(len(measures))[number])
                moved[number] = (posed_joints(other, poses) - joints) / step
        return moved

    def bulges(self, cone: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
        """Return the derivatives (K, _COEFFICIENTS) of the surface's distances from cones (K,), at
        cone coordinates (K, 4), see `place_points`, by the coefficients of their groups: harmonics
        about the axis on rings along it, and one for each cap."""
        own, along = _harmonics(coordinates), coordinates[:, 0]
        turned = np.column_stack(
            [
                np.where(self._swapped[cone], 1 - along, along),
                (self._turns[cone] @ coordinates[:, 1:, None])[..., 0],
            ]
        )
        return np.asarray(own + self._share[cone][:, None] * (_harmonics(turned) - own))


def _mirror_cone(body: BodyModel, cone: Cone) -> tuple[np.ndarray, bool, float]:
    """Return how the coordinates on a cone turn into those of the mirrored point on its twin, or on
    itself on the midline: the matrix (3, 3) of the direction, whether start and end change places,
    and the share of the twin's surface in this cone's: 0 for the left, 1 for the right, 1/2
    between."""
    other = {"l_": "r_", "r_": "l_"}.get(cone.name[:2], "") + sideless(cone.name)
    twin = next((each for each in body.cones if each.name == other), cone)
    first, second = _cone_frame(cone) * [1, -1, 1], _cone_frame(twin)
    share = 1.0 if cone.name.startswith("r_") else 0.0 if twin is not cone else 0.5
    return second @ first.T, float(second[0] @ first[0]) < 0, share


def _is_disc(cone: Cone) -> bool:
    """Return whether a cone is so short that an end that moved alone would turn it."""
    return bool(np.linalg.norm(cone.end - cone.start) < np.mean(cone.radii) / 2)


def _cone_frame(cone: Cone) -> np.ndarray:
    """Return rows (3, 3): axis, side and the direction across both."""
    axis = (cone.end - cone.start) / np.linalg.norm(cone.end - cone.start)
    return np.stack([axis, cone.side, cross(axis, cone.side)])


def _harmonics(coordinates: np.ndarray) -> np.ndarray:
    """Return (K, _COEFFICIENTS) values at cone coordinates (K, 4), see `PersonalShape.bulges`."""
    t, along, x, y = coordinates.T
    rings = np.maximum(0, 1 - np.abs(t[:, None] * (_RINGS - 1) - np.arange(_RINGS)))
    waves = np.stack([np.ones_like(x), x, y, x * x - y * y, 2 * x * y], 1)
    caps = np.stack([np.maximum(-along, 0), np.maximum(along, 0)], 1)
    return np.concatenate([(rings[:, :, None] * waves[:, None]).reshape(len(t), -1), caps], 1)


@dataclass(frozen=True, eq=False)
class _Normal:
    """The normal equations of some `frames`: matrices pose by pose (M, D, D), pose by measures (M,
    D, S) and measures by measures (M, S, S), and gradients (M, D), (M, S)."""

    frames: slice
    poses: np.ndarray
    mixed: np.ndarray
    measures: np.ndarray
    pull: np.ndarray
    gradient: np.ndarray

    def eliminate(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the poses' response to each measure (M, D, S), and their own steps (M, D); both
        are to be subtracted."""
        solved = np.linalg.solve(
            self.poses, np.concatenate([self.mixed, self.pull[..., None]], axis=-1)
        )
        return solved[..., :-1], solved[..., -1]

    def reduce(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the result of `eliminate`, and the sums of the normal equations (S, S), (S,) of
        the measures that are left."""
        response, step = self.eliminate()
        mixed = self.mixed.swapaxes(1, 2)
        matrix = (self.measures - mixed @ response).sum(0)
        return response, step, matrix, (self.gradient - (mixed @ step[..., None])[..., 0]).sum(0)


class PersonalFit:
    """The fit of a template's measures and poses to outlines."""

    def __init__(self, template: BodyModel) -> None:
        self.template, self.shape = template, PersonalShape(template)
        posture = np.where(np.isfinite(template.posture_sigma), template.posture_sigma, _FREE)
        self._prior = posture**-2.0 / _FRAMES
        self._soles = [c for c, cone in enumerate(template.cones) if sideless(cone.name) == "foot"]

    def measure(
        self, outlines: Sequence[Outlines], poses: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the measures (S,) that fit to the outlines of some of M frames, evenly chosen, and
        their covariance (S, S). poses: (M, D), as tracked."""
        usable = [number for number, of in enumerate(outlines) if len(of) >= _LEAST]
        chosen = [usable[k] for k in pick_evenly(len(usable), _FRAMES)]
        measures, covariance = np.zeros(len(self.shape.spread)), np.diag(self.shape.spread**2)
        some, tracked = [outlines[number] for number in chosen], poses[chosen]
        moved = tracked
        for reach in REACHES if chosen else ():
            precision = self.shape.spread**-2.0
            matrix, vector = np.diag(precision), precision * measures
            found = self._linearise(_Normal.reduce, measures, moved, tracked, some, reach)
            for _, _, own, pull in found:
                matrix += own
                vector += pull
            covariance = np.linalg.inv(matrix)
            change = -covariance @ vector
            measures = measures + change
            steps = [response @ change + step for response, step, _, _ in found]
            moved = self._clip(moved - np.concatenate(steps))
        return measures, covariance

    def pose(
        self, measures: np.ndarray, outlines: Sequence[Outlines], poses: np.ndarray
    ) -> np.ndarray:
        """Return the poses (M, D) of the body with these measures that fit to the outlines of M
        frames, near the tracked ones."""
        usable = np.array([len(of) >= _LEAST for of in outlines])
        some = [of for of, use in zip(outlines, usable, strict=True) if use]
        fitted = poses.copy()
        for _ in range(_STEPS if some else 0):
            found = self._linearise(
                _Normal.eliminate, measures, fitted[usable], poses[usable], some, REACHES[-1],
                free=False,
            )  # fmt: skip
            fitted[usable] = self._clip(fitted[usable] - np.concatenate([s for _, s in found]))
        return fitted

    def joint_covariance(
        self,
        measures: np.ndarray,
        covariance: np.ndarray,
        outlines: Sequence[Outlines],
        poses: np.ndarray,
    ) -> np.ndarray:
        """Return the covariance (M, J, 3, 3), m^2, of the joints in poses (M, D) of the body with
        these measures, whose covariance (S, S) is given: what the outlines of the frame and of the
        take leave open."""
        body, count = self.shape.body(measures), len(self.template.joints)
        bones = np.array([joint.bone for joint in body.joints])
        moves = bone_point_jacobian(body, poses, bones, posed_joints(body, poses))
        moves = moves.swapaxes(2, 3).reshape(len(poses), 3 * count, -1)
        moved = self.shape.move_joints(measures, poses).reshape(self.shape.n_built, len(poses), -1)

        def leave_open(normal: _Normal) -> np.ndarray:
            turns = moves[normal.frames]
            grown = -turns @ normal.eliminate()[0]
            grown[..., : self.shape.n_built] += np.moveaxis(moved[:, normal.frames], 0, -1)
            alone = np.linalg.solve(normal.poses, turns.swapaxes(1, 2)).swapaxes(1, 2)
            by_joint = len(turns), count, 3, -1
            pairs = (turns, alone), (grown @ covariance, grown)
            return np.asarray(
                sum(a.reshape(by_joint) @ b.reshape(by_joint).swapaxes(2, 3) for a, b in pairs)
            )

        found = self._linearise(leave_open, measures, poses, poses, outlines, REACHES[-1])
        return np.concatenate([np.zeros((0, count, 3, 3)), *found])

    def length_deviations(self, measures: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """Return the standard deviations (E,), m, of the lengths of the body's edges."""
        pose, edges = self.template.rest_pose[None], np.array(self.template.edges).reshape(-1, 2)
        moved = self.shape.move_joints(measures, pose)[:, 0]
        joints = posed_joints(self.shape.body(measures), pose)[0]
        along = np.diff(joints[edges], axis=1)[:, 0]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        grown = np.sum(np.diff(moved[:, edges], axis=2)[:, :, 0] * along, axis=-1)
        built = covariance[: self.shape.n_built, : self.shape.n_built]
        return np.asarray(np.sqrt(np.einsum("me,mn,ne->e", grown, built, grown)))

    def _linearise(
        self,
        use: Callable[[_Normal], T],
        measures: np.ndarray,
        poses: np.ndarray,
        tracked: np.ndarray,
        outlines: Sequence[Outlines],
        reach: float,
        *,
        free: bool = True,
    ) -> list[T]:
        """Return what `use` makes of the normal equations of some frames after the other, in
        threads. free: whether the measures may change."""
        shape, template = self.shape, self.template
        body, n = shape.body(measures), template.n_dof
        cones = posed_cones(body, poses)
        growths = np.zeros((len(poses), 0, len(template.cones), 8))
        if free:
            growths = shape.growths(measures, poses)
        soles = cones[:, self._soles]
        lowest = (soles[..., [2, 6]] - soles[..., [3, 7]]).min((1, 2), initial=0.0)
        has_floor = bool(self._soles) and bool(np.median(lowest) > -FLOOR)
        moves = cone_motions(body, world_axes(body, poses))
        if free:
            ends = np.zeros((*growths.shape[:2], moves.shape[1], 6 + 8))
            ends[..., 6:] = growths
            moves = np.concatenate([np.pad(moves, [(0, 0)] * 3 + [(0, 8)]), ends.swapaxes(1, 2)], 2)
        bulges = measures[shape.n_built :].reshape(-1, _COEFFICIENTS)
        n_blocks = max(1, -(-len(poses) // _TOGETHER))
        together = max(1, -(-len(poses) // n_blocks))  # blocks of about the same size

        def linearise(first: int) -> T:
            block = slice(first, min(first + together, len(poses)))
            own, n_cones = cones[block], len(template.cones)
            frame, cone, coordinates, normal, gap = nearest_outline(outlines[block], own)
            mine = own[frame, cone]
            bulged = shape.bulges(cone, coordinates)
            gap = gap - np.sum(bulged * bulges[shape.group[cone]], axis=1)
            root = np.sqrt(robust_weights(gap, reach / REACH) / SHARED) / NOISE
            here = place_points(mine, coordinates)
            rows = [normal, cross_rows(here, normal)]
            if free:
                rows += [end_displacements(mine, coordinates[:, :1], here, normal), bulged]
            weighted, key = np.column_stack([*rows, -gap]) * root[:, None], frame * n_cones + cone
            if has_floor:
                sole, depths = self._press_soles(own, weighted.shape[1], free)
                weighted, key = np.concatenate([weighted, depths]), np.concatenate([key, sole])
            products = multiply_alike(key, weighted, len(own) * n_cones)
            matrix, vector = self._expand(
                moves[block], products.reshape(len(own), n_cones, *products.shape[1:])
            )
            diagonal = self._prior + _DAMPING * np.diagonal(matrix[:, :n, :n], axis1=1, axis2=2)
            by_pose = matrix[:, :n, :n] + diagonal[..., None] * np.eye(n)
            pull = vector[:, :n] + self._prior * (poses[block] - tracked[block])
            blocks = matrix[:, :n, n:], matrix[:, n:, n:]
            return use(_Normal(block, by_pose, *blocks, pull, vector[:, n:]))

        return list(map_in_threads(linearise, range(0, len(poses), together)))

    def _expand(self, moves: np.ndarray, products: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the matrices (M, P, P) and the gradients (M, P) of the unknowns of M frames: the
        pose, and the measures if they are free.

        moves: (M, C, P', k) how the unknowns that move a cone do so. products: (M, C, k + c + 1, k
        + c + 1), sums over a cone's rays of the products of how a ray's distance depends on the
        cone's motion, on the c coefficients of its surface, and of minus the distance.
        """
        count, n_cones, n, size = moves.shape
        turned = moves @ products[:, :, :size]
        by_cone = turned[..., :size].swapaxes(1, 2).reshape(count, n, -1)
        matrix = by_cone @ moves.swapaxes(2, 3).reshape(count, -1, n)
        vector = turned[..., -1].sum(1)
        if products.shape[2] == size + 1:
            return matrix, vector
        members, width = self.shape.members, products.shape[2] - size - 1
        mixed = members @ turned[..., size:-1].reshape(count, n_cones, -1)
        mixed = mixed.reshape(count, -1, n, width).swapaxes(1, 2).reshape(count, n, -1)
        sums = members @ products[:, :, size:-1, size:].reshape(count, n_cones, -1)
        sums = sums.reshape(count, len(members), width, width + 1)
        whole = np.zeros((count, *2 * (n + mixed.shape[2],)))
        whole[:, :n, :n], whole[:, :n, n:] = matrix, mixed
        whole[:, n:, :n] = mixed.swapaxes(1, 2)
        for group in range(len(members)):
            block = slice(n + group * width, n + (group + 1) * width)
            whole[:, block, block] = sums[:, group, :, :-1]
        return whole, np.concatenate([vector, sums[..., -1].reshape(count, -1)], axis=1)

    def _press_soles(
        self, cones: np.ndarray, width: int, free: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the soles' points in poses of the cones (M, C, 16) like rays: the numbers (K,) of
        their cones of all frames, and weighted rows (K, width), which lift those below the floor;
        the others weigh nothing."""
        sole, end = np.repeat(self._soles, 2), np.tile([0, 4], len(self._soles))
        points = np.stack([cones[:, sole, end + axis] for axis in range(4)], -1)
        heights = points[..., 2] - points[..., 3]
        rows = np.zeros((*heights.shape, width))
        rows[..., 2] = 1.0
        rows[..., 3:6] = cross_rows(points[..., :3], rows[..., :3])
        if free:
            each = np.arange(len(sole))
            rows[:, each, 6 + end + 2], rows[:, each, 6 + end + 3] = 1.0, -1.0
        rows[..., -1] = heights
        rows *= (heights < 0)[..., None] / _SOLE
        key = np.arange(len(cones))[:, None] * cones.shape[1] + sole
        return key.ravel(), rows.reshape(-1, width)

    def _clip(self, poses: np.ndarray) -> np.ndarray:
        return np.clip(poses, self.template.lower, self.template.upper)


def nearest_outline(
    outlines: Sequence[Outlines], cones: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return where the rays (K) of some frames' outlines pass nearest to posed cones (M, C, 16), or
    deepest inside one.

    The frame (K,), from 0, and the cone (K,), the coordinates (K, 4) of the point on its surface
    (see `place_points`), the surface's normal (K, 3) there, and the distance (K,) m of the ray from
    it, negative inside.
    """
    frame = np.repeat(np.arange(len(outlines)), [len(of) for of in outlines])
    axis = cones[..., 4:7] - cones[..., 0:3]
    length = np.linalg.norm(axis, axis=-1)
    # Axes in which a cone's section is a circle.
    frames = np.stack([cones[..., 8:11], cones[..., 12:15], axis / length[..., None]], 1)
    starts, directions = [], []
    for of, own, turns in zip(outlines, cones, frames, strict=True):
        centres = np.einsum("icj,vcj->ivc", turns, of.centres[:, None] - own[:, 0:3])
        starts.append(centres[:, of.views])
        directions.append(of.rays.astype(np.float64) @ turns.swapaxes(1, 2))
    start, along, reach = np.concatenate(starts, 1), np.concatenate(directions, 1), length[frame]
    across = along[0] ** 2 + along[1] ** 2
    nearest = -(start[0] * along[0] + start[1] * along[1]) / np.maximum(across, 1e-12)
    t = np.clip((start[2] + nearest * along[2]) / reach, 0, 1)
    start[2] -= t * reach
    passed = start - np.sum(start * along, 0) / (across + along[2] ** 2) * along
    distance = np.sqrt(np.sum(passed**2, 0))
    signed = distance - (cones[..., 3][frame] + t * (cones[..., 7] - cones[..., 3])[frame])
    cone, row = signed.argmin(1), np.arange(len(frame))
    direction = (passed[:, row, cone] / np.maximum(distance[row, cone], 1e-9)).T
    coordinates = np.column_stack([t[row, cone], direction[:, 2], direction[:, :2]])
    normal = (direction[:, None] @ frames[frame, :, cone])[:, 0]
    scale = np.maximum(np.linalg.norm(normal, axis=1), 1e-9)
    return frame, cone, coordinates, normal / scale[:, None], signed[row, cone] / scale


def _pair_beside(body: BodyModel, joint: Joint) -> tuple[str, ...]:
    """Return the names of the left and the right bone between whose ends a joint is, such as the
    hips for a pelvis; none for other joints."""
    sides = {bone.name: bone for bone in body.bones if bone.parent == joint.bone}
    for name, left in sides.items():
        right = sides.get(f"r_{sideless(name)}")
        if not name.startswith("l_") or right is None:
            continue
        if np.allclose(left.offset + right.offset, 2 * joint.position):
            return name, right.name
    return ()


def _mirror(name: str) -> np.ndarray:
    return np.array([1.0, -1.0 if name.startswith("r_") else 1.0, 1.0])


def _descendants(body: BodyModel) -> np.ndarray:
    """Return (B, B) bool: which bones are a bone or hang on it."""
    below = np.eye(len(body.bones), dtype=bool)
    for index, bone in enumerate(body.bones):
        if bone.parent >= 0:
            below[:, index] |= below[:, bone.parent]
    return below
