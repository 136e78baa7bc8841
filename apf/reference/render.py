"""The flat model drawn into pictures. Twin of render.cl."""

from __future__ import annotations

import numpy as np

from apf.reference.cones import outlines
from psfs.camera import Camera


def flat_body(
    camera: Camera, cones: np.ndarray, edged: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What posed cones (C, 16) look like to `camera`: parts and edges, both (h, w).

    parts: number of the cone seen, from 1; 0 is background. A cone hides those whose middle is
    farther away (painter's algorithm, Rymut 2016, 5.2). edges: bool, visible pixels of a cone that
    have one of their four neighbours beyond its long sides (Kwolek & Rymut 2016, section 3: what
    the ends of a limb show is no edge but a joint), for those cones that are `edged` (C,).
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
