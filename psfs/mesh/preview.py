"""Draw a mesh from several sides, and its outline in the input pictures."""

from __future__ import annotations

import numpy as np
import trimesh

from psfs.cameras.camera import CameraRig
from psfs.mesh.marching_cubes import vertex_colours
from psfs.mesh.raycast import RayScene
from psfs.output.preview import (
    BACKDROP,
    CLAY,
    PANEL,
    SUPERSAMPLING,
    VIEWS,
    View,
    compute_lighting,
    downsample,
    draw_sheet,
)
from psfs.sequence import Frame


def draw_mesh_preview(
    mesh: trimesh.Trimesh, rig: CameraRig, frame: Frame, title: str = ""
) -> np.ndarray:
    """Draw (h, w, 3) uint8 BGR: the same sheet as `psfs.output.preview.preview`, of a mesh."""
    scene = RayScene(mesh)
    views = [draw_shaded_mesh(scene, azimuth, up, PANEL) for azimuth, up in VIEWS]
    text = f"{title}   {len(mesh.faces):,} triangles   volume {mesh.volume * 1e3:.3g} l"
    return draw_sheet(views, text, lambda view: scene.silhouette(rig[view]), rig, frame)


def draw_shaded_mesh(
    scene: RayScene, azimuth: float, elevation: float, size: tuple[int, int]
) -> np.ndarray:
    """Draw an orthographic view (h, w, 3) uint8 BGR, as `draw_shaded_view` does of clouds."""
    mesh = scene.mesh
    width, height = size[0] * SUPERSAMPLING, size[1] * SUPERSAMPLING
    extent = float(mesh.extents.max())
    view = View.fit(mesh.vertices, 0.02 * extent, azimuth, elevation, (width, height))
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    across = (np.stack([columns, rows], -1).reshape(-1, 2) - view.middle) / view.scale
    origins = view.centre + across @ view.axes[:2] - 2 * extent * view.axes[2]
    hit, corners, weights = scene.find_first_hits(origins, view.axes[2])
    normals = np.einsum("nc,ncx->nx", weights, mesh.vertex_normals[corners])
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
    colours, base = vertex_colours(mesh), CLAY
    if colours is not None:
        base = np.einsum("nc,ncx->nx", weights, colours[corners])[:, ::-1]
    picture = np.broadcast_to(BACKDROP, (width * height, 3)).copy()
    picture[hit] = base * compute_lighting(normals @ view.axes.T)[:, None]
    return downsample(picture.reshape(height, width, 3))
