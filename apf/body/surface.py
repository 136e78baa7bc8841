"""A person's surface: a mesh that the bones of the body move, with its colours and its measures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from apf.body.kinematics import bone_matrices, posed_cones
from apf.body.mesh import BodyMesh, skinned_mesh
from apf.body.model import BodyModel
from cl import InputError
from psfs.background.gaussian import stack_median
from psfs.common.cones import cone_distances
from psfs.common.progress import map_in_threads

#: Distance, m, over which the surface's errors are alike and one bone takes over from another;
#: smaller shares than LEAST are none.
ALIKE, _LEAST = 0.02, 0.02


@dataclass(frozen=True, eq=False)
class Surface:
    """The surface of a person whose body is in `pose` (D,).

    vertices: (M, 3) m in the world. faces: (T, 3) int, counter-clockwise seen from outside.
    deviation: (M,) m, standard deviation along the normals. common: standard deviation, m, of an
    error that is the same everywhere. lengths: (E,) m, standard deviations of the lengths of the
    body's edges. colours: (M, 3) uint8 RGB; empty where there are no pictures.
    """

    pose: np.ndarray
    vertices: np.ndarray
    faces: np.ndarray
    deviation: np.ndarray
    common: np.ndarray
    lengths: np.ndarray
    colours: np.ndarray

    def __post_init__(self) -> None:
        if self.faces.size and self.faces.max() >= len(self.vertices):
            raise InputError(
                f"a surface's faces name vertex {self.faces.max()}; found {len(self.vertices)}"
            )

    def bind(self, body: BodyModel) -> BodyMesh:
        """Return the mesh that the bones of `body` move."""
        body = body.without_load
        weights = blend_bones(self.vertices, body, self.pose)
        return skinned_mesh(self.vertices, self.faces, weights, body, self.pose)

    def measure(self, body: BodyModel) -> dict[str, Any]:
        """Return the volume, litres, and the girths of the body's parts at their middles, m, as a
        tape finds them: each a list of value and standard deviation."""
        body = body.without_load
        corners = self.vertices[self.faces].astype(float)
        across = _cross_faces(corners)
        areas = np.linalg.norm(across, axis=1) / 2
        volume = np.sum(corners[:, 0] * across) / 6
        area = np.bincount(self.faces.ravel(), np.repeat(areas / 3, 3), len(self.vertices))
        # errors are alike within a disc of this area about each vertex
        variance = 4 * np.pi * ALIKE**2 * np.sum(area * self.deviation**2)
        error = float(np.sqrt(variance + (areas.sum() * self.common) ** 2))
        girths = {}
        owner = blend_bones(self.vertices, body, self.pose).argmax(1)
        cones = posed_cones(body, self.pose[None])[0]
        for part, cone in zip(body.cones, cones, strict=True):
            middle, axis = (cone[0:3] + cone[4:7]) / 2, cone[4:7] - cone[0:3]
            along = _find_direction(body, self.pose, part.bone)
            if along is not None and abs(along @ axis) < np.linalg.norm(axis) / 2:
                axis = along  # a part that lies across its bone, such as hips
            axis = axis / np.linalg.norm(axis)
            lines, on = _cut(corners, axis, middle)
            lines = lines[(owner[self.faces[on]] == part.bone).all(1)].reshape(-1, 3)
            if len(lines) < 6:
                continue
            across = np.linalg.svd(axis[None])[2][1:]
            hull = scipy.spatial.ConvexHull((lines - middle) @ across.T)
            round_it = self.deviation[np.unique(self.faces[on])].mean()
            alone = np.sqrt(min(1.0, 2 * np.sqrt(np.pi) * ALIKE / hull.area)) * round_it
            deviation = float(np.hypot(alone, self.common))
            girths[part.name] = _with_error(hull.area, 2 * np.pi * deviation, 3)
        return {"volume_l": _with_error(1e3 * volume, 1e3 * error, 2), "girths_m": girths}


def blend_bones(points: np.ndarray, body: BodyModel, pose: np.ndarray) -> np.ndarray:
    """Return by how much each bone moves points (N, 3) near `body` in `pose` (D,): shares (N, B),
    which pass from one cone's bone to the next within `ALIKE`."""
    distances = cone_distances(points, posed_cones(body, pose[None])[0])
    weights = np.exp(-(distances - distances.min(1, keepdims=True)) / ALIKE)
    shares = weights @ np.eye(len(body.bones))[[cone.bone for cone in body.cones]]
    shares /= shares.sum(1, keepdims=True)
    shares[shares < _LEAST] = 0
    return np.asarray(shares / shares.sum(1, keepdims=True))


def choose_spread_pose(body: BodyModel, poses: np.ndarray) -> np.ndarray:
    """Return that of the poses (N, D) in which parts that do not hang together are farthest apart,
    so that no surface joins them."""
    cones = posed_cones(body, poses)
    middles, radii = (cones[..., 0:3] + cones[..., 4:7]) / 2, (cones[..., 3] + cones[..., 7]) / 2
    gaps = np.linalg.norm(middles[:, :, None] - middles[:, None], axis=-1)
    gaps = gaps - radii[:, :, None] - radii[:, None]
    return np.asarray(poses[np.minimum(gaps, 2 * radii.mean()).mean((1, 2)).argmax()])


def paint(
    surface: Surface,
    body: BodyModel,
    poses: np.ndarray,
    clouds: Sequence[tuple[np.ndarray, np.ndarray]],
) -> np.ndarray:
    """Return the colours (M, 3) uint8 of a surface: for each vertex the median, over some frames,
    of the nearest coloured points. poses: (N, D). clouds: points (K, 3), m, and their colours (K,
    3) uint8, of each frame."""
    mesh = surface.bind(body)

    def look(shown: tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        pose, (points, colours) = shown
        vertices = mesh.posed(body, pose[None])[0][0]
        return np.asarray(colours[scipy.spatial.cKDTree(points).query(vertices)[1]])

    painted = np.stack(list(map_in_threads(look, zip(poses, clouds, strict=True))))
    return stack_median(painted).astype(np.uint8)


def normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return (M, 3) float32 unit normals of the vertices of a surface: means of those of the faces
    around them, by their angles there."""
    corners = vertices[faces].astype(float)
    sides = [np.roll(corners, -by, axis=1) - corners for by in (1, 2)]
    sides = [s / np.maximum(np.linalg.norm(s, axis=2, keepdims=True), 1e-12) for s in sides]
    angles = np.arccos(np.clip(np.sum(sides[0] * sides[1], axis=2), -1, 1))
    across = _cross_faces(corners)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    weights = (angles[..., None] * across[:, None]).reshape(-1, 3)
    sums = np.stack([np.bincount(faces.ravel(), w, len(vertices)) for w in weights.T], axis=1)
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return (sums / np.maximum(lengths, 1e-12)).astype(np.float32)


def _cross_faces(corners: np.ndarray) -> np.ndarray:
    """Return the normals (T, 3), m^2, of faces with these corners (T, 3, 3), m, as long as twice
    their areas."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _find_direction(body: BodyModel, pose: np.ndarray, bone: int) -> np.ndarray | None:
    """Return the direction (3,) from a bone to the middle of the bones on it; None without any."""
    offsets = [each.offset for each in body.bones if each.parent == bone]
    along = np.mean(offsets, axis=0) if offsets else np.zeros(3)
    if not along.any():
        return None
    return np.asarray(bone_matrices(body, pose[None])[0][0, bone] @ along / np.linalg.norm(along))


def _cut(
    corners: np.ndarray, normal: np.ndarray, origin: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the lines (K, 2, 3) in which a plane cuts faces with these corners (T, 3, 3), and the
    numbers of the faces (K,)."""
    heights = (corners - origin) @ normal
    above = heights > 0
    on = np.flatnonzero((above.any(1)) & ~above.all(1))
    alone = np.where(above[on].sum(1) == 1, above[on].argmax(1), above[on].argmin(1))
    order = (alone[:, None] + np.arange(3)) % 3  # the corner on a side of its own first
    sorted_heights = np.take_along_axis(heights[on], order, axis=1)
    ends = np.take_along_axis(corners[on], order[..., None], axis=1)
    share = sorted_heights[:, :1] / (sorted_heights[:, :1] - sorted_heights[:, 1:])
    return ends[:, :1] + share[..., None] * (ends[:, 1:] - ends[:, :1]), on


def _with_error(value: float, error: float, digits: int) -> list[float]:
    return [round(float(value), digits), round(float(error), digits)]
