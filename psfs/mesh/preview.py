"""Silhouettes of a mesh by Open3D's rays (Embree), and drawings of it."""

from __future__ import annotations

import ctypes
import os
from functools import cache
from typing import Any

import numpy as np
import trimesh

from cl.errors import InputError, pip_command
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
    """Return (h, w) bool: pixels whose ray, with lens distortion, meets the mesh."""
    open3d = load_open3d()
    scene = open3d.t.geometry.RaycastingScene()
    # Embree computes in float32: coordinates relative to the mesh's centre lose no precision.
    middle = mesh.bounds.mean(0)
    scene.add_triangles(
        open3d.core.Tensor((mesh.vertices - middle).astype(np.float32)),
        open3d.core.Tensor(np.asarray(mesh.faces, np.uint32)),
    )
    directions = camera.rays(np.indices(camera.size).reshape(2, -1).T)
    origins = np.broadcast_to(camera.centre - middle, directions.shape)
    rays = open3d.core.Tensor(np.concatenate([origins, directions], -1).astype(np.float32))
    return np.asarray(scene.test_occlusions(rays).numpy().reshape(camera.size).T)


@cache
def load_open3d() -> Any:
    """Import open3d with the libusb of the package `libusb-package`, as bare machines have none.

    Raises InputError if the extra `mesh` is not installed."""
    # In notebooks Open3D would start a web server and print a message.
    os.environ.setdefault("OPEN3D_DISABLE_WEB_VISUALIZER", "true")
    try:
        import libusb_package

        if library := libusb_package.get_library_path():
            ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
        import open3d
    except ImportError as error:
        raise InputError(
            f"silhouettes of meshes need Open3D ({error}); expected: {pip_command('mesh')}"
        ) from None
    return open3d
