"""Bodies drawn into pictures. Twin of parts.cl and render.cl, of skin.cl and render_mesh.cl."""

from __future__ import annotations

import numpy as np

from apf.body.cones import FAR_OUT, project_outlines
from apf.body.kinematics import posed_cones
from apf.body.mesh import BodyMesh
from apf.body.model import BodyModel
from apf.image_objective.renderer import cone_edges
from psfs.cameras.camera import Camera, CameraRig

#: What a camera sees: the number of the part, from 1, and whether it is an edge, both (h, w).
Picture = tuple[np.ndarray, np.ndarray]


def draw_hypotheses(
    body: BodyModel,
    rig: CameraRig,
    poses: np.ndarray,
    mesh: BodyMesh | None = None,
    round_ends: bool = False,
) -> list[list[Picture]]:
    """Draw pictures by camera and pose of `poses` (N, D): of the body's cones, or of its mesh."""
    if mesh is None:
        return draw_cones(body, rig, posed_cones(body, poses), round_ends)
    vertices, middles = mesh.posed(body, poses)
    posed = list(zip(vertices, middles, strict=True))
    return [[mesh_body(camera, mesh, *shape) for shape in posed] for camera in rig]


def draw_cones(
    body: BodyModel, rig: CameraRig, cones: np.ndarray, round_ends: bool = False
) -> list[list[Picture]]:
    """Draw pictures by camera and pose of the posed cones (N, C, 16) of `body`."""
    edged, free = cone_edges(body)
    return [[flat_body(camera, c, edged, free, round_ends) for c in cones] for camera in rig]


def flat_body(
    camera: Camera, cones: np.ndarray, edged: np.ndarray, free: np.ndarray, round_ends: bool = False
) -> Picture:
    """Draw what posed cones (C, 16) look like to `camera`.

    A cone hides those whose middle is farther away (painter's algorithm, Rymut 2016, 5.2). Edges
    are the visible pixels of a cone that have one of their four neighbours beyond its long sides
    (Kwolek & Rymut 2016, section 3: what the ends of a limb show is no edge but a joint) or beyond
    one of its ends that are `free` (C, 2), for those cones that are `edged` (C,).
    """
    width, height = camera.size
    rows, columns = np.mgrid[-1 : height + 1, -1 : width + 1].astype(np.float64)
    parts = np.zeros((height, width), np.uint8)
    edges = np.zeros((height, width), bool)
    middles = (cones[:, 0:3] + cones[:, 4:7]) / 2
    away = np.linalg.norm(middles - camera.centre, axis=-1)
    for c in np.argsort(-away, kind="stable"):
        corners = project_outlines(camera, cones[c])
        if np.isnan(corners).any():
            continue
        mine, inner = flat_part(corners, columns, rows, free[c], round_ends)
        parts[mine] = c + 1
        edges[mine] = edged[c] & ~inner[mine]
    return parts, edges


def flat_part(
    corners: np.ndarray, columns: np.ndarray, rows: np.ndarray, free: np.ndarray, round_ends: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return which pixels a cone with `corners` (4, 2) covers, and which of them are no edge; both
    without the border of the pixels (columns, rows).

    It is the trapezoid, Rymut 2016, 4.3, and with round ends a disc at each; rows are filled from
    their first pixel to their last. Seen along its axis, where the trapezoid is shorter than its
    wider end's radius, it is the discs alone, without round ends one in its middle; all of their
    outline is an edge.
    """
    ends = np.stack([corners[:2].mean(0), corners[2:].mean(0)])
    radii = np.linalg.norm(corners[[0, 2]] - corners[[1, 3]], axis=-1) / 2
    bare = np.linalg.norm(ends[0] - ends[1]) < radii.max()
    outlined = np.array([bare, bare]) | (free & round_ends)
    if not round_ends:
        ends, radii = np.stack([ends.mean(0)] * 2), np.full(2, radii.max() * bare)
    shapes = [
        (columns - x) ** 2 + (rows - y) ** 2 <= r**2 for (x, y), r in zip(ends, radii, strict=True)
    ]
    insides = [erode(disc) for disc, rim in zip(shapes, outlined, strict=True) if rim]
    if not bare:
        sides = half_planes(corners, columns, rows)
        edges = sides[[outlined[0], True, outlined[1], True]]
        shapes.append(np.logical_and.reduce(sides))
        insides.append(erode(np.logical_and.reduce(edges)))
    return fill_rows(shapes)[1:-1, 1:-1], fill_rows(insides)


def half_planes(corners: np.ndarray, columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return (4, H, W) which pixels lie on the inner side of each side of a trapezoid (4, 2)."""
    (px, py), (qx, qy) = corners[2] - corners[0], corners[3] - corners[1]
    turn = np.sign(px * qy - py * qx)
    within = []
    for (x, y), (next_x, next_y) in zip(corners, np.roll(corners, -1, 0), strict=True):
        dx, dy = next_x - x, next_y - y
        within.append(turn * (dx * (rows - y) - dy * (columns - x)) >= 0)
    return np.array(within)


def erode(mask: np.ndarray) -> np.ndarray:
    """Return the pixels of `mask` (H, W) with all four neighbours in it, without the border."""
    return mask[1:-1, 1:-1] & mask[:-2, 1:-1] & mask[2:, 1:-1] & mask[1:-1, :-2] & mask[1:-1, 2:]


def fill_rows(masks: list[np.ndarray]) -> np.ndarray:
    """Return (H, W) the pixels between the first and the last of a row in any of `masks`."""
    either = np.logical_or.reduce(masks)
    from_left = np.logical_or.accumulate(either, 1)
    return from_left & np.logical_or.accumulate(either[:, ::-1], 1)[:, ::-1]


def mesh_body(camera: Camera, mesh: BodyMesh, vertices: np.ndarray, middles: np.ndarray) -> Picture:
    """Draw as `flat_body` does, of a posed mesh: vertices (M, 3), its parts' middles (P, 3).

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
    away = np.linalg.norm(middles - camera.centre, axis=-1)
    columns = np.arange(-1, width + 1)
    for p in np.argsort(-away, kind="stable"):
        low, high = row_spans(pixels[lines[owners == p, :2]], np.arange(-1, height + 1))
        mask = (columns >= low[:, None]) & (columns <= high[:, None])
        mine = mask[1:-1, 1:-1]
        parts[mine] = p + 1
        edges[mine] = mesh.edged[p] & ~erode(mask)[mine]
    return parts, edges


def row_spans(ends: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the largest column (R,) where lines between `ends` (L, 2, 2) x, y meet
    the rows (R,); infinite, the least above the largest, where none does."""
    (x0, y0), (x1, y1) = np.moveaxis(ends, 0, -1)
    rises = np.where(y1 == y0, np.nan, y1 - y0)  # lines along rows end at others
    y = rows[:, None]
    at = x0 + (y - y0) * (x1 - x0) / rises
    met = (y >= np.minimum(y0, y1)) & (y <= np.maximum(y0, y1)) & np.isfinite(rises)
    low = np.where(met, at, np.inf).min(1, initial=np.inf)
    return low, np.where(met, at, -np.inf).max(1, initial=-np.inf)
