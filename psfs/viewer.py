"""Open3D's window, the only place where Open3D is imported."""

from __future__ import annotations

import ctypes
import os
import sys
from typing import Any

import numpy as np

from psfs.camera import CameraRig
from psfs.preview import normals_of
from psfs.runs import Run

_CLAY = (0.80, 0.70, 0.59)


def has_display() -> bool:
    """Can a window be opened?"""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def load_open3d() -> Any:
    """Open3D; its libusb comes from the package `libusb-package`, as bare machines have none."""
    import libusb_package

    library = libusb_package.get_library_path()
    if library:
        ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    import open3d

    return open3d


def show(run: Run, rig: CameraRig, start: int) -> None:
    """A window with the clouds of a run, beginning with frame `start`: arrow keys change the
    frame, Q closes. Returns when the window is closed."""
    open3d = load_open3d()
    frames = run.indices
    position = frames.index(start)
    shown = _point_cloud(open3d, run, start)
    window = open3d.visualization.VisualizerWithKeyCallback()
    window.create_window(f"{run.out}: arrow keys change the frame", 1280, 800)
    window.add_geometry(shown)
    window.add_geometry(_cameras(open3d, rig))
    window.add_geometry(open3d.geometry.TriangleMesh.create_coordinate_frame(0.3))

    def step(by: int) -> Any:
        def change(window: Any) -> bool:
            nonlocal position
            position = (position + by) % len(frames)
            cloud = _point_cloud(open3d, run, frames[position])
            shown.points, shown.colors, shown.normals = cloud.points, cloud.colors, cloud.normals
            return bool(window.update_geometry(shown))

        return change

    right, left = 262, 263  # GLFW's key codes
    window.register_key_callback(right, step(1))
    window.register_key_callback(left, step(-1))
    window.run()
    window.destroy_window()


def _point_cloud(open3d: Any, run: Run, index: int) -> Any:
    cloud = run.cloud(index)
    points = open3d.geometry.PointCloud()
    points.points = open3d.utility.Vector3dVector(cloud.centres)
    colours = np.full((len(cloud), 3), _CLAY) if cloud.colour is None else cloud.colour / 255
    points.colors = open3d.utility.Vector3dVector(colours)
    points.normals = open3d.utility.Vector3dVector(normals_of(cloud))
    return points


def _cameras(open3d: Any, rig: CameraRig) -> Any:
    """The pyramids of the views, a tenth of the cameras' distance deep."""
    depth = 0.1 * float(np.linalg.norm(rig.centres - rig.centres.mean(0), axis=1).mean() or 1.0)
    lines = open3d.geometry.LineSet()
    for camera in rig:
        extrinsic = np.eye(4)
        extrinsic[:3, :3], extrinsic[:3, 3] = camera.R, camera.t
        lines += open3d.geometry.LineSet.create_camera_visualization(
            *camera.size, camera.K, extrinsic, depth
        )
    return lines
