"""Silhouettes of a mesh, and drawings of it."""

from __future__ import annotations

import numpy as np
import trimesh

from psfs.cameras.camera import Camera, CameraRig
from psfs.mesh.marching_cubes import vertex_colours
from psfs.output.preview import draw_sheet, draw_views
from psfs.sequence import Frame


def draw_mesh_preview(
    mesh: trimesh.Trimesh, rig: CameraRig, frame: Frame, title: str = ""
) -> np.ndarray:
    """Draw (h, w, 3) uint8 BGR: the same sheet as `psfs.output.preview.draw_preview`, of a mesh."""
    width = float(mesh.edges_unique_length.max())
    views = draw_views(mesh.vertices, mesh.vertex_normals, vertex_colours(mesh), width)
    text = f"{title}   {len(mesh.faces):,} triangles   volume {mesh.volume * 1e3:.3g} l"
    return draw_sheet(views, text, lambda view: mesh_silhouette(mesh, rig[view]), rig, frame)


def mesh_silhouette(mesh: trimesh.Trimesh, camera: Camera) -> np.ndarray:
    """Return (h, w) bool: pixels whose centre lies in a projected triangle.

    The corners are projected with lens distortion; the edges between them are straight. Triangles
    with a corner that has no image are left out.
    """
    width, height = camera.size
    pixels, depth = camera.project(mesh.vertices)
    corners = pixels[mesh.faces][(depth[mesh.faces] > 0).all(1)]
    # A row of pixels for each triangle and each row of the picture that it meets.
    first = np.clip(np.ceil(corners[..., 1].min(1)), 0, height).astype(int)
    counts = np.clip(np.floor(corners[..., 1].max(1)) + 1, first, height).astype(int) - first
    triangle = np.repeat(np.arange(len(corners)), counts)
    row = np.arange(len(triangle)) - np.repeat(counts.cumsum() - counts - first, counts)
    ends = corners[triangle]
    along = np.roll(ends, -1, axis=1) - ends
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (row[:, None] - ends[..., 1]) / along[..., 1]
        met = (share >= 0) & (share <= 1)
        crossing = ends[..., 0] + share * along[..., 0]
    left = np.where(met, crossing, np.inf).min(1, initial=np.inf)
    right = np.where(met, crossing, -np.inf).max(1, initial=-np.inf)
    begin = np.clip(np.ceil(left), 0, width).astype(int)
    end = np.clip(np.floor(right) + 1, begin, width).astype(int)
    marks = np.zeros((height, width + 1), int)
    np.add.at(marks, (row, begin), 1)
    np.add.at(marks, (row, end), -1)
    return marks.cumsum(1)[:, :width] > 0
