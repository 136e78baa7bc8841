"""Open3D's window: clouds or meshes, frame by frame, with the cameras."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import trimesh

from cl import InputError
from psfs.cameras.camera import CameraRig
from psfs.common.open3d import load_open3d
from psfs.mesh.marching_cubes import CLAY, vertex_colours
from psfs.output.preview import BACKDROP, normals_of
from psfs.voxels.grid import VoxelCloud

KEYS = "arrow keys change the frame, space plays, Q closes"
_SPACE, _RIGHT, _LEFT = 32, 262, 263  # GLFW's key codes


def has_display() -> bool:
    """Can a window be opened?"""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def show(
    title: str,
    rig: CameraRig,
    frames: Sequence[int],
    start: int,
    shape: Callable[[int], VoxelCloud | trimesh.Trimesh],
) -> None:
    """A window with `shape(frame)`, beginning with frame `start`, and the pyramids of the views;
    for the keys see KEYS. Returns when the window is closed. Raises InputError if none opens."""
    window = load_open3d().visualization.VisualizerWithKeyCallback()
    if not window.create_window(f"{title}: {KEYS}", 1280, 800):
        raise InputError("the display gives no window; --png FILE writes a picture instead")
    player = _Player(window, frames, start, shape)
    window.add_geometry(_cameras(rig), False)
    window.register_key_callback(_RIGHT, lambda _: player.step(1))
    window.register_key_callback(_LEFT, lambda _: player.step(-1))
    window.register_key_callback(_SPACE, lambda _: player.toggle())
    window.register_animation_callback(lambda _: player.playing and player.step(1))
    options = window.get_render_option()
    options.background_color = BACKDROP[::-1] / 255
    options.mesh_shade_option = load_open3d().visualization.MeshShadeOption.Color  # smooth
    window.run()
    window.destroy_window()


class _Player:
    """The frame that a window shows."""

    def __init__(
        self,
        window: Any,
        frames: Sequence[int],
        start: int,
        shape: Callable[[int], VoxelCloud | trimesh.Trimesh],
    ) -> None:
        self.window, self.frames, self.shape = window, frames, shape
        self.position = frames.index(start)
        self.playing = False
        self.geometry = _geometry(shape(start))
        window.add_geometry(self.geometry)
        view = window.get_view_control()
        view.set_up([0, 0, 1])
        view.set_front([1, -0.35, 0.25])
        view.set_zoom(0.7)

    def step(self, by: int) -> bool:
        """To another frame, round and round; the viewer's place stays."""
        self.position = (self.position + by) % len(self.frames)
        self.window.remove_geometry(self.geometry, False)
        self.geometry = _geometry(self.shape(self.frames[self.position]))
        self.window.add_geometry(self.geometry, False)
        return True

    def toggle(self) -> bool:
        self.playing = not self.playing
        return False


def _geometry(shape: VoxelCloud | trimesh.Trimesh) -> Any:
    """Open3D's form of a cloud or a mesh."""
    open3d = load_open3d()
    vector = open3d.utility.Vector3dVector
    if isinstance(shape, VoxelCloud):
        vertices, faces, normals, colours = cubes(shape)
    else:
        # Copies: Open3D takes nothing that is locked against writing.
        vertices, faces = np.array(shape.vertices), np.array(shape.faces, np.int32)
        normals, colours = np.array(shape.vertex_normals), vertex_colours(shape)
    mesh = open3d.geometry.TriangleMesh(vector(vertices), open3d.utility.Vector3iVector(faces))
    mesh.vertex_normals = vector(normals)
    mesh.compute_triangle_normals()  # a mesh that lacks either kind is drawn without light
    if colours is None:
        mesh.paint_uniform_color(CLAY)
    else:
        mesh.vertex_colors = vector(colours / 255)
    return mesh


def cubes(cloud: VoxelCloud) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
    """The voxels as cubes: vertices (8 N, 3) m, triangles (12 N, 3), the vertices' normals, which
    are those of the surface, and their colours, if any."""
    corners = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), -1).reshape(8, 3)
    vertices = cloud.centres[:, None] + (corners - 0.5) * cloud.grid.voxel_size
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = np.array([[q[i] for i in half] for q in quads for half in ((0, 1, 2), (0, 2, 3))])
    faces = 8 * np.arange(len(cloud))[:, None, None] + triangles
    colours = None if cloud.colour is None else np.repeat(cloud.colour, 8, axis=0)
    normals = np.repeat(normals_of(cloud), 8, axis=0)
    return vertices.reshape(-1, 3), faces.reshape(-1, 3).astype(np.int32), normals, colours


def _cameras(rig: CameraRig) -> Any:
    """The pyramids of the views, a tenth of the cameras' distance deep."""
    open3d = load_open3d()
    depth = 0.1 * float(np.linalg.norm(rig.centres - rig.centres.mean(0), axis=1).mean() or 1.0)
    lines = open3d.geometry.LineSet()
    for camera in rig:
        extrinsic = np.eye(4)
        extrinsic[:3, :3], extrinsic[:3, 3] = camera.R, camera.t
        lines += open3d.geometry.LineSet.create_camera_visualization(
            *camera.size, camera.K, extrinsic, depth
        )
    return lines
