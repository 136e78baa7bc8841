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

    A part fills each row of pixels from its first line to its last, as convex ones do; lines with
    an end that is unseen are left out. It hides the parts whose middle is farther away. Its edge
    are its pixels with one of four neighbours outside of it.
    """
    width, height = camera.size
    pixels, depth = camera.project(vertices)
    seen = (depth > 0) & (np.abs(pixels) < FAR_OUT).all(-1)
    lines, owners = mesh.lines()
    lines, owners = lines[seen[lines[:, :2]].all(1)], owners[seen[lines[:, :2]].all(1)]
    parts, edges = np.zeros((height, width), np.uint8), np.zeros((height, width), bool)
    distances = np.linalg.norm(middles - camera.centre, axis=-1)
    columns = np.arange(-1, width + 1)
    for p in np.argsort(-distances, kind="stable"):
        low, high = row_spans(pixels[lines[owners == p, :2]], np.arange(-1, height + 1))
        mask = (columns >= low[:, None]) & (columns <= high[:, None])
        inner = mask[:-2, 1:-1] & mask[2:, 1:-1] & mask[1:-1, :-2] & mask[1:-1, 2:]
        mine = mask[1:-1, 1:-1]
        parts[mine] = p + 1
        edges[mine] = mesh.edged[p] & ~inner[mine]
    return parts, edges


def row_spans(ends: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest column (R,) where lines between `ends` (L, 2, 2) x, y meet the rows (R,);
    infinite, the least above the largest, where none does."""
    (x0, y0), (x1, y1) = np.moveaxis(ends, 0, -1)
    rises = np.where(y1 == y0, np.nan, y1 - y0)  # lines along rows end at others
    y = rows[:, None]
    at = x0 + (y - y0) * (x1 - x0) / rises
    met = (y >= np.minimum(y0, y1)) & (y <= np.maximum(y0, y1)) & np.isfinite(rises)
    low = np.where(met, at, np.inf).min(1, initial=np.inf)
    return low, np.where(met, at, -np.inf).max(1, initial=-np.inf)
