"""Fit a person's own body to the outlines of many frames: joints where the parts turn.

Every point of a silhouette's outline is a ray that touches the body. The unknowns are the poses
and, shared by all frames, the body's measures: lengths, the places of joints in the flesh, ends and
radii of the cones. Gauss-Newton on the distances of the rays from the nearest cone; poses are
eliminated frame by frame (Schur complement, Triggs et al. 2000). Where the take does not show a
measure, it stays where anatomy puts it, see `_SPREAD`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from apf.body.jacobian import point_jacobian
from apf.body.kinematics import bone_matrices, posed_cones
from apf.body.limbs import limb_chains
from apf.body.model import BodyModel, Bone, Cone, sideless
from apf.initialisation.shape_model import place_points, surface_displacements
from psfs.cameras.camera import CameraRig
from psfs.common.least_squares import REACH, robust_weights
from psfs.common.numbers import pick_evenly

#: Standard deviations of a person's measures around a body of the same stature. Lengths: those of
#: adults of one stature vary by 3 to 4 % (Gordon et al. 2014, ANSUR II). Joints in the flesh, m:
#: regressions from bony marks miss hip centres by 15 to 25 mm (Leardini et al. 1999). Ends of
#: cones, m, and logs of their radii: by hand; people are no cones, and hulls are thicker than they.
_SPREAD = {"length": 0.04, "joint": 0.015, "end": 0.01, "radius": 0.15}
#: Standard deviations of an angle without a posture prior, rad, and of the root, m and rad, around
#: the tracked pose.
_FREE, _ROOT = 3.0, 0.2
#: Accuracy, m, of a cone's outline, and number of neighbouring rays that share one error.
_NOISE, _SHARED = 0.02, 8.0
#: Most rays of a view, fewest rays of a frame, and most frames that inform the measures.
_RAYS, _LEAST, _FRAMES = 80, 40, 24
#: Distances, m, at which a ray counts a quarter, from the first step to the last.
_REACHES = np.geomspace(0.08, 0.03, 7)
#: Number of steps of poses whose body is known.
_STEPS = 3
#: Share of a pose's own normal matrix added to its diagonal (Levenberg 1944).
_DAMPING = 1e-3


@dataclass(frozen=True, eq=False)
class Outlines:
    """Rays (K, 3) float32 through the outlines of one frame's silhouettes, of length 1, the camera
    (K,) uint8 of each, and the centres (V, 3) m of all cameras."""

    rays: np.ndarray
    views: np.ndarray
    centres: np.ndarray

    def __len__(self) -> int:
        return len(self.rays)


def find_outlines(rig: CameraRig, shown: np.ndarray, known: np.ndarray) -> Outlines:
    """Return evenly chosen rays of the outlines of silhouettes `shown` (V, H, W) bool, without
    those at the border of a picture or beside what is not `known` (V, H, W)."""
    views, rays = [np.zeros(0)], [np.zeros((0, 3))]
    window = np.ones((3, 3), np.uint8)
    for view, (camera, mask, inside) in enumerate(zip(rig, shown, known, strict=True)):
        opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, window)
        lines, _ = cv2.findContours(opened, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        beyond = cv2.erode(
            inside.astype(np.uint8), window, borderType=cv2.BORDER_CONSTANT, borderValue=0
        )
        pixels = np.concatenate([np.zeros((0, 2), int), *(line[:, 0] for line in lines)])
        pixels = pixels[beyond[pixels[:, 1], pixels[:, 0]] > 0]
        if len(pixels):
            pixels = pixels[pick_evenly(len(pixels), _RAYS)]
            through = camera.rays(pixels.astype(float))
            through = through[np.isfinite(through).all(1)]
            rays.append(through / np.linalg.norm(through, axis=1)[:, None])
            views.append(np.full(len(through), view))
    all_rays, of_view = np.concatenate(rays), np.concatenate(views)
    return Outlines(all_rays.astype(np.float32), of_view.astype(np.uint8), rig.centres)


class PersonalShape:
    """Measures (S,) of a person, 0 for the template's: logs of lengths, displacements of joints and
    of cones' ends in the frames of their bones, logs of radii. Left mirrors right.

    spread: (S,) standard deviations. index: the number of each measure, by its kind, the name of
    its part, the end and the axis.
    """

    def __init__(self, template: BodyModel) -> None:
        self.template = template
        size = template.scale_groups
        bones = [bone for bone in template.bones if bone.parent >= 0]
        self._rows: list[tuple[str, str, int, int]] = [("length", group, 0, 0) for group in size]
        for name in dict.fromkeys(sideless(bone.name) for bone in bones):
            self._rows += [("joint", name, 0, axis) for axis in self._axes(name, bones)]
        for name in template.radius_groups:
            for end in (0, 1):
                axes = self._axes(name, template.cones)
                self._rows += [("end", name, end, axis) for axis in axes]
                self._rows.append(("radius", name, end, 0))
        self.index = {row: number for number, row in enumerate(self._rows)}
        self.spread = np.array([_SPREAD[kind] for kind, *_ in self._rows])

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

        scaled = template.scaled({g: np.exp(value("length", g)) for g in template.scale_groups})
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
        return replace(scaled, bones=tuple(bones), cones=tuple(cones))

    def growths(self, measures: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Return the derivatives (M, S, C, 8) of the ends and radii of the cones by the measures,
        in poses (M, D)."""
        template, step = self.template, 1e-4
        body = self.body(measures)
        cones = posed_cones(body, poses)[..., :8]
        rotations, _ = bone_matrices(body, poses)
        below = _descendants(template)[:, [cone.bone for cone in template.cones]]
        found = np.zeros((len(poses), len(measures), len(template.cones), 8))
        for number, (kind, name, end, axis) in enumerate(self._rows):
            here = slice(4 * end, 4 * end + 3)
            if kind == "length":
                moved = posed_cones(self.body(measures + step * _unit(number, measures)), poses)
                found[:, number] = (moved[..., :8] - cones) / step
            elif kind == "joint":
                for index, bone in enumerate(template.bones):
                    if sideless(bone.name) == name:
                        along = rotations[:, bone.parent, :, axis] * _mirror(bone.name)[axis]
                        for first in (0, 4):
                            moving = np.flatnonzero(below[index])
                            found[:, number, moving, first : first + 3] = along[:, None]
            else:
                for index, cone in enumerate(template.cones):
                    if sideless(cone.name) == name and kind == "end":
                        along = rotations[:, cone.bone, :, axis] * _mirror(cone.name)[axis]
                        found[:, number, index, here] = along
                    elif sideless(cone.name) == name:
                        found[:, number, index, here.stop] = cones[:, index, here.stop]
        return found


class PersonalFit:
    """The fit of a template's measures and poses to outlines."""

    def __init__(self, template: BodyModel) -> None:
        self.template, self.shape = template, PersonalShape(template)
        self._spread = np.where(np.isfinite(template.posture_sigma), template.posture_sigma, _FREE)
        self._spread[[axis.dof for axis in template.bones[0].axes]] = _ROOT
        ends = {bone for chain in limb_chains(template) for bone in chain}
        # A foot turns about an ankle that the body does not have; clothes are not the body.
        self._counted = np.array([
            not cone.loose and (cone.in_images or cone.bone not in ends) for cone in template.cones
        ])  # fmt: skip

    def measure(
        self, outlines: Sequence[Outlines], poses: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the measures (S,) that fit to the outlines of some of M frames, evenly chosen, and
        their standard deviations (S,). poses: (M, D), as tracked."""
        usable = [number for number, of in enumerate(outlines) if len(of) >= _LEAST]
        chosen = [usable[k] for k in pick_evenly(len(usable), _FRAMES)]
        measures = np.zeros(len(self.shape.spread))
        if not chosen:
            return measures, self.shape.spread
        some, tracked = [outlines[number] for number in chosen], poses[chosen]
        moved = tracked
        for reach in _REACHES:
            measures, moved, covariance = self._step(measures, moved, tracked, some, reach)
        return measures, np.sqrt(np.diag(covariance))

    def pose(
        self, measures: np.ndarray, outlines: Sequence[Outlines], poses: np.ndarray
    ) -> np.ndarray:
        """Return the poses (M, D) of the body with these measures that fit to the outlines of M
        frames, near the tracked ones."""
        usable = np.array([len(of) >= _LEAST for of in outlines])
        some = [of for of, use in zip(outlines, usable, strict=True) if use]
        fitted, body = poses.copy(), self.shape.body(measures)
        for _ in range(_STEPS):
            if some:
                moved = self._linearise(body, fitted[usable], poses[usable], some, _REACHES[-1])
                steps = np.stack([solved[:, -1] for solved, *_ in moved])
                fitted[usable] = self._clip(fitted[usable] - steps)
        return fitted

    def _step(
        self,
        measures: np.ndarray,
        poses: np.ndarray,
        tracked: np.ndarray,
        outlines: Sequence[Outlines],
        reach: float,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return measures (S,) and poses (M, D) after a Gauss-Newton step, and the measures'
        covariance (S, S)."""
        growths = self.shape.growths(measures, poses)
        precision = self.shape.spread**-2.0
        matrix, vector = np.diag(precision), precision * measures
        body = self.shape.body(measures)
        solutions = self._linearise(body, poses, tracked, outlines, reach, growths)
        for solved, mixed, own, gradient in solutions:
            matrix = matrix + own - mixed.T @ solved[:, :-1]
            vector = vector + gradient - mixed.T @ solved[:, -1]
        covariance = np.linalg.inv(matrix)
        change = -covariance @ vector
        steps = np.stack([solved[:, :-1] @ change + solved[:, -1] for solved, *_ in solutions])
        return measures + change, self._clip(poses - steps), covariance

    def _linearise(
        self,
        body: BodyModel,
        poses: np.ndarray,
        tracked: np.ndarray,
        outlines: Sequence[Outlines],
        reach: float,
        growths: np.ndarray | None = None,
    ) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        """Return for each frame, with its pose eliminated: the pose's response to each measure and
        its own step (D, S + 1), the normal matrices pose by measures (D, S) and measures by
        measures (S, S), and the gradient (S,)."""
        n, found = body.n_dof, []
        cones = posed_cones(body, poses)
        if growths is None:
            growths = np.zeros((len(poses), 0, len(body.cones), 8))
        with threadpool_limits(1, "blas"):  # the products are small
            for of, pose, start, mine, growth in zip(
                outlines, poses, tracked, cones, growths, strict=True
            ):
                cone, coordinates, normal, gap = nearest_outline(of, mine)
                here = place_points(mine[cone], coordinates)
                rows = np.concatenate([
                    point_jacobian(body, pose, cone, here, normal),
                    surface_displacements(mine, growth, cone, coordinates, normal),
                ])  # fmt: skip
                weight = robust_weights(gap, reach / REACH) * self._counted[cone]
                weighted = rows * (weight / (_SHARED * _NOISE**2))
                matrix, vector = weighted @ rows.T, -weighted @ gap
                prior = self._spread**-2.0
                own = matrix[:n, :n] + np.diag(prior + _DAMPING * np.diag(matrix[:n, :n]))
                pull = vector[:n] + prior * (pose - start)
                right = np.concatenate([matrix[:n, n:], pull[:, None]], 1)
                solved = np.linalg.solve(own, right)
                found.append((solved, matrix[:n, n:], matrix[n:, n:], vector[n:]))
        return found

    def _clip(self, poses: np.ndarray) -> np.ndarray:
        return np.clip(poses, self.template.lower, self.template.upper)


def nearest_outline(
    outlines: Outlines, cones: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return where rays (K) pass nearest to posed cones (C, 16), or deepest inside one.

    The cone (K,), the coordinates (K, 4) of the point on its surface (see `place_points`), the
    surface's normal (K, 3) there, and the distance (K,) m of the ray from it, negative inside.
    """
    origins, rays = outlines.centres[outlines.views], outlines.rays.astype(np.float64)
    axis = cones[:, 4:7] - cones[:, 0:3]
    length = np.linalg.norm(axis, axis=-1)
    # Axes in which a cone's section is a circle.
    frames = np.stack([cones[:, 8:11], cones[:, 12:15], axis / length[:, None]], 1)
    start = np.einsum("cij,kcj->kci", frames, origins[:, None] - cones[:, 0:3])
    along = np.einsum("cij,kj->kci", frames, rays)
    across = np.maximum((along[..., :2] ** 2).sum(-1), 1e-12)
    nearest = -(start[..., :2] * along[..., :2]).sum(-1) / across
    t = np.clip((start[..., 2] + nearest * along[..., 2]) / length, 0, 1)
    start[..., 2] -= t * length
    passed = start - (np.sum(start * along, -1) / np.sum(along**2, -1))[..., None] * along
    distance = np.linalg.norm(passed, axis=-1)
    signed = distance - (cones[:, 3] + t * (cones[:, 7] - cones[:, 3]))
    cone, row = signed.argmin(1), np.arange(len(rays))
    direction = passed[row, cone] / np.maximum(distance[row, cone], 1e-9)[:, None]
    coordinates = np.column_stack([t[row, cone], direction[:, 2], direction[:, :2]])
    normal = np.einsum("kij,ki->kj", frames[cone], direction)
    scale = np.maximum(np.linalg.norm(normal, axis=1), 1e-9)
    return cone, coordinates, normal / scale[:, None], signed[row, cone] / scale


def _mirror(name: str) -> np.ndarray:
    return np.array([1.0, -1.0 if name.startswith("r_") else 1.0, 1.0])


def _unit(number: int, like: np.ndarray) -> np.ndarray:
    return np.eye(1, len(like), number)[0]


def _descendants(body: BodyModel) -> np.ndarray:
    """Return (B, B) bool: which bones are a bone or hang on it."""
    below = np.eye(len(body.bones), dtype=bool)
    for index, bone in enumerate(body.bones):
        if bone.parent >= 0:
            below[:, index] |= below[:, bone.parent]
    return below
