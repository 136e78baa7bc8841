"""Rays at a mesh (Open3D's Embree), and drawings of it: from several sides, in the pictures."""

from __future__ import annotations

import ctypes
import os
from functools import cache
from typing import Any

import numpy as np
import trimesh

from psfs.cameras.camera import Camera, CameraRig
from psfs.mesh.marching_cubes import vertex_colours
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


class RayScene:
    """A mesh that rays can be cast at."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self.mesh = mesh
        self._tensor: Any = load_open3d().core.Tensor
        self._scene = load_open3d().t.geometry.RaycastingScene()
        # Embree computes in float32: coordinates relative to the mesh's centre lose no precision.
        self._middle = mesh.bounds.mean(0)
        self._scene.add_triangles(
            self._tensor((mesh.vertices - self._middle).astype(np.float32)),
            self._tensor(np.asarray(mesh.faces, np.uint32)),
        )

    def _rays(self, origins: np.ndarray, directions: np.ndarray) -> object:
        """Return rays (N, 6) float32; origins and directions broadcast."""
        origins, directions = np.broadcast_arrays(origins - self._middle, directions)
        return self._tensor(np.concatenate([origins, directions], -1).astype(np.float32))

    def hits(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Return for each ray whether it meets the mesh, (N,) bool."""
        return self._scene.test_occlusions(self._rays(origins, directions)).numpy()

    def find_first_hits(
        self, origins: np.ndarray, directions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Find the first triangle that each ray meets.

        Returns (N,) bool, whether a ray meets any; for the M that do, the triangle's vertices (M,
        3) and barycentric weights (M, 3).
        """
        answer = self._scene.cast_rays(self._rays(origins, directions))
        hit = np.isfinite(answer["t_hit"].numpy())
        corners = np.asarray(self.mesh.faces)[answer["primitive_ids"].numpy()[hit]]
        u, v = answer["primitive_uvs"].numpy()[hit].T
        return hit, corners, np.stack([1 - u - v, u, v], -1)

    def silhouette(self, camera: Camera) -> np.ndarray:
        """Return (h, w) bool: pixels whose ray, with lens distortion, meets the mesh."""
        width, height = camera.size
        low, high = np.zeros(2, int), np.array([width, height])
        pixels, depth = camera.project(self.mesh.vertices)
        if (depth > 0).all():  # otherwise no rectangle is known to contain the mesh
            low = np.clip(np.floor(pixels.min(0)), low, high).astype(int)
            high = np.clip(np.ceil(pixels.max(0)) + 1, low, high).astype(int)
        columns, rows = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
        shown = np.zeros((height, width), bool)
        if columns.size:
            directions = camera.rays(np.stack([columns.ravel(), rows.ravel()], -1))
            shown[rows.ravel(), columns.ravel()] = self.hits(camera.centre, directions)
        return shown


@cache
def load_open3d() -> Any:
    """Import open3d with the libusb of the package `libusb-package`, as bare machines have none."""
    import libusb_package

    library = libusb_package.get_library_path()
    if library:
        ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    # In notebooks Open3D would start a web server and print a message.
    os.environ.setdefault("OPEN3D_DISABLE_WEB_VISUALIZER", "true")
    import open3d

    return open3d
