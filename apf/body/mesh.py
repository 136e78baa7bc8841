"""Triangle meshes of the body that its bones move (Rymut 2016, 4.3 and table 6.5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from apf.body.kinematics import bone_matrices, posed_cones
from apf.body.model import BodyModel, Cone
from cl import InputError
from psfs.common.cones import cone_distances
from psfs.common.files import MOST_BYTES
from psfs.common.npz import Values, read_npz
from psfs.common.reading import open_input

#: Vertices per part of the frusta of table 6.5: a square base, then elliptic ones.
FRUSTUM_VERTICES = (8, 18, 34, 66, 130, 258, 514)
#: Most bones that move one vertex; smaller weights are dropped.
MAX_BONES = 4
#: Most parts: pictures number them in bytes, from 1.
MAX_PARTS = np.iinfo(np.uint8).max
#: Vertices around a cone with rounded ends.
_SEGMENTS = 16
#: Most vertices of a user's mesh, and their greatest distance from the origin, m.
_MOST_VERTICES, _FARTHEST = 2_000_000, 100.0


@dataclass(frozen=True, eq=False)
class BodyMesh:
    """A mesh bound to the bones of a body by linear blend skinning, Rymut 2016 eq. (4.25).

    bones: (M, K) int. weights: (M, K) with sum 1. positions: (M, K, 3) m of the vertex in the frame
    of each of its bones; K = 1 is rigid skinning. faces: (T, 3) int. parts: (T,) int, part of each
    face; a part hides those behind it as a whole. edged: (P,) bool, whether a part's outline is an
    edge. names: (P,) of the parts.
    """

    bones: np.ndarray
    weights: np.ndarray
    positions: np.ndarray
    faces: np.ndarray
    parts: np.ndarray
    edged: np.ndarray
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        if self.n_parts > MAX_PARTS:
            raise InputError(f"a mesh of {self.n_parts} parts; expected at most {MAX_PARTS}")

    @property
    def n_vertices(self) -> int:
        return len(self.bones)

    @property
    def n_parts(self) -> int:
        return len(self.names)

    def lines(self) -> tuple[np.ndarray, np.ndarray]:
        """Return lines (L, 4) int32 and their parts (L,) int32.

        A line is its two ends and the third corners of the part's two triangles that meet there; -1
        where there are not two triangles.
        """
        corners: dict[tuple[int, int, int], list[int]] = {}
        for (a, b, c), part in zip(self.faces.tolist(), self.parts.tolist(), strict=True):
            for p, q, third in ((a, b, c), (b, c, a), (c, a, b)):
                corners.setdefault((part, min(p, q), max(p, q)), []).append(third)
        lines = [
            (p, q, *(thirds if len(thirds) == 2 else (-1, -1)))
            for (_, p, q), thirds in corners.items()
        ]
        owners = [part for part, _, _ in corners]
        return np.array(lines, np.int32), np.array(owners, np.int32)

    @cached_property
    def middles(self) -> tuple[np.ndarray, np.ndarray]:
        """For each part the point at which its depth is taken.

        That is the mean of the vertices that the part's main bone moves most: bones (P,), and
        points (P, 3) m in their frames.
        """
        main = self.bones[np.arange(self.n_vertices), self.weights.argmax(1)]
        local = self.positions[np.arange(self.n_vertices), self.weights.argmax(1)]
        bones, points = np.zeros(self.n_parts, int), np.zeros((self.n_parts, 3))
        for part in range(self.n_parts):
            vertices = np.unique(self.faces[self.parts == part])
            bones[part] = np.bincount(main[vertices]).argmax()
            points[part] = local[vertices[main[vertices] == bones[part]]].mean(0)
        return bones, points

    def posed(self, body: BodyModel, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return vertices (N, M, 3) m and part centres (N, P, 3) m in the world for poses (N, D).

        Rymut 2016 eq. (4.25).
        """
        rotations, origins = bone_matrices(body, poses)
        by_bone = origins[:, self.bones] + np.einsum(
            "nmkab,mkb->nmka", rotations[:, self.bones], self.positions
        )
        bones, points = self.middles
        middles = origins[:, bones] + np.einsum("npab,pb->npa", rotations[:, bones], points)
        return np.einsum("mk,nmka->nma", self.weights, by_bone), middles


def cone_mesh(body: BodyModel, vertices_per_part: int) -> BodyMesh:
    """Make frusta of the cones of `body`; vertices_per_part: one of FRUSTUM_VERTICES.

    8: a square base of the ellipse's area; else rings of (n - 2) / 2 vertices on the ellipses and
    the ends' centres. Raises InputError for another number.
    """
    if vertices_per_part not in FRUSTUM_VERTICES:
        raise InputError(
            f"{vertices_per_part} vertices per part; expected one of "
            f"{', '.join(map(str, FRUSTUM_VERTICES))}"
        )
    return _cone_parts(body, [_frustum(cone, vertices_per_part) for cone in body.cones])


def rounded_mesh(body: BodyModel) -> BodyMesh:
    """Make the cones of `body` with rounded ends, the shape that `cone_distances` measures."""
    return _cone_parts(body, [_capsule(cone, _SEGMENTS) for cone in body.cones])


def _cone_parts(body: BodyModel, meshes: list[tuple[np.ndarray, np.ndarray]]) -> BodyMesh:
    """Make a mesh with one part per cone; meshes: vertices m in the bone's frame, and faces, of
    equal counts."""
    n = len(meshes[0][0])
    n_faces = [len(faces) for _, faces in meshes]
    return BodyMesh(
        bones=np.repeat([cone.bone for cone in body.cones], n)[:, None],
        weights=np.ones((n * len(meshes), 1)),
        positions=np.concatenate([points for points, _ in meshes])[:, None],
        faces=np.concatenate([faces + n * i for i, (_, faces) in enumerate(meshes)]),
        parts=np.repeat(np.arange(len(meshes)), n_faces),
        edged=np.array([cone.in_images for cone in body.cones]),
        names=tuple(body.cone_names),
    )


def _frustum(cone: Cone, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (n, 3) m in the bone's frame and faces (T, 3) of a cone."""
    if n > 8:
        rings = [(cone.start, cone.radii[0]), (cone.end, cone.radii[1])]
        return _revolve(cone, _circle((n - 2) // 2), rings, [cone.start, cone.end])
    # The square's corners are moved outwards so that it has the circle's area.
    reach = np.sqrt(np.pi / 2)
    rings = [(cone.start, reach * cone.radii[0]), (cone.end, reach * cone.radii[1])]
    points, faces = _revolve(cone, _circle(4) + np.pi / 4, rings, [])
    return points, np.concatenate([faces, [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]]])


def _capsule(cone: Cone, segments: int) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices m in the bone's frame and faces of a cone with rounded ends.

    Rings from its start to its end, then the two poles.
    """
    axis = (cone.end - cone.start) / np.linalg.norm(cone.end - cone.start)
    slopes = np.radians([67.5, 45.0, 22.5, 0.0])
    rings = [
        (centre + radius * np.sin(slope) * axis, radius * np.cos(slope))
        for centre, radius, side in (
            (cone.start, cone.radii[0], -slopes),
            (cone.end, cone.radii[1], slopes[::-1]),
        )
        for slope in side
    ]
    poles = [cone.start - cone.radii[0] * axis, cone.end + cone.radii[1] * axis]
    return _revolve(cone, _circle(segments), rings, poles)


def _circle(segments: int) -> np.ndarray:
    """Return the angles (segments,) rad of evenly spaced points."""
    return np.arange(segments) * 2 * np.pi / segments


def _revolve(
    cone: Cone,
    angles: np.ndarray,
    rings: Sequence[tuple[np.ndarray, float]],
    poles: Sequence[np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces of a surface about the axis of a cone: points at `angles` of
    elliptic rings, centre (3,) and radius, then the two poles beyond the first and the last."""
    axis = (cone.end - cone.start) / np.linalg.norm(cone.end - cone.start)
    across = np.cross(axis, cone.side)
    ring = (
        np.cos(angles)[:, None] * cone.side * cone.scale[0]
        + np.sin(angles)[:, None] * across * cone.scale[1]
    )
    points = [centre + radius * ring for centre, radius in rings]
    here = np.arange(len(angles))
    there, faces = (here + 1) % len(angles), list[np.ndarray]()
    for low in range(0, len(angles) * (len(rings) - 1), len(angles)):
        high = low + len(angles)
        faces.append(np.stack([low + here, low + there, high + there], -1))
        faces.append(np.stack([low + here, high + there, high + here], -1))
    if poles:
        last, n = len(angles) * (len(rings) - 1), len(angles) * len(rings)
        faces.append(np.stack([np.full(len(angles), n), there, here], -1))
        faces.append(np.stack([np.full(len(angles), n + 1), last + here, last + there], -1))
    return np.concatenate([*points, *(pole[None] for pole in poles)]), np.concatenate(faces)


def load_mesh(
    path: str | Path, body: BodyModel, pose: np.ndarray, weights: str | Path | None = None
) -> BodyMesh:
    """Read a user's mesh (any file that trimesh reads, metres), shaped as `body` is in `pose` (D,).

    weights: an npz file with `weights` (M, B), a column for each bone of `body` in its order, or
    for those in its `bones` (names). Without it each vertex moves with the bone of the nearest
    cone. The parts are the bones; a face belongs to the one that moves it most. Raises
    MissingFileError, or InputError naming the file that is wrong.
    """
    import trimesh  # slower to import than the rest of this package

    open_input(Path(path), "a mesh that trimesh reads").close()
    if Path(path).stat().st_size > MOST_BYTES:
        raise InputError(f"{path}: more than {MOST_BYTES // 2**20} MiB; expected a mesh")
    try:
        mesh: Any = trimesh.load(path, force="mesh", process=False)
        vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    except Exception as error:  # its readers raise exceptions of all kinds
        raise InputError(
            f"{path}: not a mesh that trimesh reads: {type(error).__name__} {str(error)[:100]}"
        ) from None
    if not len(faces) or not 0 <= faces.min() <= faces.max() < len(vertices) <= _MOST_VERTICES:
        raise InputError(
            f"{path}: {len(vertices)} vertices, {len(faces)} faces; expected a surface of at most "
            f"{_MOST_VERTICES:,} vertices"
        )
    if not np.abs(vertices).max() <= _FARTHEST:  # rejects NaN, too
        raise InputError(
            f"{path}: vertices up to {np.abs(vertices).max():g} m from the origin; expected metres"
        )
    if weights is None:
        gaps = cone_distances(vertices, posed_cones(body, pose[None])[0])
        bones = np.array([cone.bone for cone in body.cones])[gaps.argmin(1)]
        table = np.eye(len(body.bones))[bones]
    else:
        table = _read_weights(Path(weights), body, len(vertices))
    return skinned_mesh(vertices, faces, table, body, pose)


def skinned_mesh(
    vertices: np.ndarray, faces: np.ndarray, weights: np.ndarray, body: BodyModel, pose: np.ndarray
) -> BodyMesh:
    """Bind vertices (M, 3) m to the bones of `body` in `pose` (D,) with weights (M, B)."""
    n_bones = min(MAX_BONES, int((weights > 0).sum(1).max()))
    bones = np.argsort(-weights, axis=1, kind="stable")[:, :n_bones]
    strongest = np.take_along_axis(weights, bones, 1)
    strongest = strongest / strongest.sum(1, keepdims=True)
    rotations, origins = (array[0] for array in bone_matrices(body, pose[None]))
    offset = vertices[:, None] - origins[bones]
    of_face = np.sort(bones[:, 0][faces], 1)[:, 1]  # the bone of two corners, if two agree
    used = np.unique(of_face)
    return BodyMesh(
        bones=bones,
        weights=strongest,
        positions=np.einsum("mkba,mkb->mka", rotations[bones], offset),
        faces=faces,
        parts=np.searchsorted(used, of_face),
        edged=np.ones(len(used), bool),
        names=tuple(body.bones[b].name for b in used),
    )


def _read_weights(path: Path, body: BodyModel, n_vertices: int) -> np.ndarray:
    """Read weights (M, B) and normalise each row to sum 1. Raises InputError naming the file."""
    schema = {"weights": Values(None, low=0), "bones": Values(("B",), "text", needed=False)}
    data = read_npz(path, schema, "the array weights, vertices x bones")
    table = np.asarray(data["weights"], np.float64)
    names = [bone.name for bone in body.bones]
    given = [str(name) for name in data.get("bones", names)]
    unknown = [name for name in given if name not in names]
    if unknown:
        raise InputError(
            f"{path}: no bone {unknown[0]!r} in {body.name}; known: {', '.join(names)}"
        )
    if table.shape != (n_vertices, len(given)):
        raise InputError(
            f"{path}: weights are {table.shape}; expected {(n_vertices, len(given))}, "
            "vertices x bones"
        )
    if not (np.isfinite(table).all() and (table >= 0).all() and (table.sum(1) > 0).all()):
        raise InputError(f"{path}: weights below 0, or a vertex without; expected shares of bones")
    out = np.zeros((n_vertices, len(names)))
    out[:, [names.index(name) for name in given]] = table
    return out / out.sum(1, keepdims=True)
