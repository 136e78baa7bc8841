"""Bodies drawn into pictures. Twin of render.cl and render_mesh.cl."""

from __future__ import annotations

import numpy as np

from apf.body import BodyModel
from apf.meshes import BodyMesh
from apf.reference.cones import FAR_OUT, outlines
from apf.reference.kinematics import posed_cones
from psfs.camera import Camera, CameraRig

#: What a camera sees: the number of the part, from 1, and whether it is an edge, both (h, w).
Picture = tuple[np.ndarray, np.ndarray]


def draw_hypotheses(
    body: BodyModel, rig: CameraRig, poses: np.ndarray, mesh: BodyMesh | None = None
) -> list[list[Picture]]:
    """Pictures by camera and pose of `poses` (N, D): of the body's cones, or of its mesh."""
    if mesh is None:
        return draw_cones(body, rig, posed_cones(body, poses))
    vertices, middles = mesh.posed(body, poses)
    posed = list(zip(vertices, middles, strict=True))
    return [[mesh_body(camera, mesh, *shape) for shape in posed] for camera in rig]


def draw_cones(body: BodyModel, rig: CameraRig, cones: np.ndarray) -> list[list[Picture]]:
    """Pictures by camera and pose of the posed cones (N, C, 16) of `body`."""
    edged = np.array([cone.in_images for cone in body.cones])
    return [[flat_body(camera, posed, edged) for posed in cones] for camera in rig]


def flat_body(camera: Camera, cones: np.ndarray, edged: np.ndarray) -> Picture:
    """What posed cones (C, 16) look like to `camera`.

    A cone hides those whose middle is farther away (painter's algorithm, Rymut 2016, 5.2). Edges
    are the visible pixels of a cone that have one of their four neighbours beyond its long sides
    (Kwolek & Rymut 2016, section 3: what the ends of a limb show is no edge but a joint), for those
    cones that are `edged` (C,).
    """
    width, height = camera.size
    rows, columns = np.mgrid[-1 : height + 1, -1 : width + 1].astype(np.float64)
    parts = np.zeros((height, width), np.uint8)
    edges = np.zeros((height, width), bool)
    middles = (cones[:, 0:3] + cones[:, 4:7]) / 2
    distances = np.linalg.norm(middles - camera.centre, axis=-1)
    for c in np.argsort(-distances, kind="stable"):
        corners = outlines(camera, cones[c])
        if np.isnan(corners).any():
            continue
        shape, between = trapezoid(corners, columns, rows)
        mine = shape[1:-1, 1:-1]
        inner = between[:-2, 1:-1] & between[2:, 1:-1] & between[1:-1, :-2] & between[1:-1, 2:]
        parts[mine] = c + 1
        edges[mine] = edged[c] & ~inner[mine]
    return parts, edges


def trapezoid(
    corners: np.ndarray, columns: np.ndarray, rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Which pixels (columns, rows) lie within `corners` (4, 2), and which between its long sides.

    A cone seen along its axis, whose trapezoid is less than half as long as wide, is a disc
    instead, its circumference an edge.
    """
    wide = max(np.linalg.norm(corners[0] - corners[1]), np.linalg.norm(corners[2] - corners[3]))
    a, b = (corners[0] + corners[1]) / 2, (corners[2] + corners[3]) / 2
    if np.linalg.norm(a - b) < 0.5 * wide:
        x, y = (a + b) / 2
        disc = (columns - x) ** 2 + (rows - y) ** 2 <= (0.5 * wide) ** 2
        return disc, disc
    (px, py), (qx, qy) = corners[2] - corners[0], corners[3] - corners[1]
    turn = np.sign(px * qy - py * qx)
    within = []
    for (x, y), (next_x, next_y) in zip(corners, np.roll(corners, -1, 0), strict=True):
        dx, dy = next_x - x, next_y - y
        within.append(turn * (dx * (rows - y) - dy * (columns - x)) >= 0)
    return within[0] & within[1] & within[2] & within[3], within[1] & within[3]


def mesh_body(camera: Camera, mesh: BodyMesh, vertices: np.ndarray, middles: np.ndarray) -> Picture:
    """As `flat_body`, of a posed mesh: vertices (M, 3), its parts' middles (P, 3).

    A part is the union of its triangles that are seen whole; it hides the parts whose middle is
    farther away. Its edge are its pixels with one of four neighbours outside of it.
    """
    width, height = camera.size
    pixels, depth = camera.project(vertices)
    seen = (depth > 0) & (np.abs(pixels) < FAR_OUT).all(-1)
    parts, edges = np.zeros((height, width), np.uint8), np.zeros((height, width), bool)
    distances = np.linalg.norm(middles - camera.centre, axis=-1)
    for p in np.argsort(-distances, kind="stable"):
        mask = np.zeros((height + 2, width + 2), bool)
        for face in mesh.faces[mesh.parts == p]:
            if seen[face].all():
                fill_triangle(mask, pixels[face] + 1)
        inner = mask[:-2, 1:-1] & mask[2:, 1:-1] & mask[1:-1, :-2] & mask[1:-1, 2:]
        mine = mask[1:-1, 1:-1]
        parts[mine] = p + 1
        edges[mine] = mesh.edged[p] & ~inner[mine]
    return parts, edges


def fill_triangle(mask: np.ndarray, corners: np.ndarray) -> None:
    """Set the pixels of `mask` within a triangle, corners (3, 2) x, y; its border belongs to it."""
    height, width = mask.shape
    x0, y0 = np.maximum(np.ceil(corners.min(0)), 0).astype(int)
    x1, y1 = np.minimum(np.floor(corners.max(0)), (width - 1, height - 1)).astype(int)
    if x0 > x1 or y0 > y1:
        return
    rows, columns = np.mgrid[y0 : y1 + 1, x0 : x1 + 1]
    sides = []
    for (x, y), (next_x, next_y) in zip(corners, np.roll(corners, -1, 0), strict=True):
        sides.append((next_x - x) * (rows - y) - (next_y - y) * (columns - x))
    inside = np.all(np.array(sides) >= 0, axis=0) | np.all(np.array(sides) <= 0, axis=0)
    mask[y0 : y1 + 1, x0 : x1 + 1] |= inside
