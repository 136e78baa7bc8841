"""Nodes of the page's 3-D view: voxels, meshes, cameras, the floor, a box; one class each."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import scipy

from psfs.cameras.camera import CameraRig
from psfs.common.numbers import FROM_Y_UP
from psfs.page.clouds import Points, Surface, grid_centre
from psfs.voxels.grid import VoxelGrid

if TYPE_CHECKING:
    import viser

_HANDLE = 0.8  # m
#: The points of line segments that show nothing.
NO_LINES = np.zeros((1, 2, 3), np.float32)


#: Lowest and highest corner (3,) m.
Box = tuple[np.ndarray, np.ndarray]
#: Distance around points that a view without voxels shows, m.
_AROUND = 1.0


class VoxelNode:
    """The surface of one frame: its voxels as points, or a mesh."""

    #: Share of a voxel's side that its point fills.
    filling = 1.0

    def __init__(self, scene: viser.SceneApi, grid: VoxelGrid | None) -> None:
        self._scene = scene
        size, centre = (grid.voxel_size, grid_centre(grid)) if grid else (1.0, np.zeros(3))
        self._node = scene.add_point_cloud(
            "/voxels", np.zeros((1, 3), np.float16), np.zeros((1, 3), np.uint8),
            point_size=size, point_shape="square", point_shading="flat", position=centre,
            visible=False,
        )  # fmt: skip
        self._mesh: viser.GlbHandle | None = None
        self.shown: Points | Surface | None = None

    @property
    def visible(self) -> bool:
        """Whether anything is shown."""
        return self._mesh is not None or bool(self._node.visible)

    def show(self, shown: Points | Surface | None) -> None:
        """Show these points, or this mesh; nothing for None."""
        if shown is self.shown:
            return
        self.shown = shown
        if self._mesh is not None:
            self._mesh.remove()
            self._mesh = None
        if isinstance(shown, Surface):
            back = to_quaternion(FROM_Y_UP)
            self._mesh = self._scene.add_glb("/mesh", shown.glb, wxyz=back)
        elif shown is not None and len(shown.positions):
            self._node.points, self._node.colors = shown.positions, shown.colours
            self._node.point_size = self.filling * shown.size
        self._node.visible = isinstance(shown, Points) and len(shown.positions) > 0


class CameraNodes:
    """The cameras as frusta, with their pictures inside and their names above them."""

    def __init__(self, scene: viser.SceneApi, rig: CameraRig) -> None:
        depth = 0.12 * float(np.linalg.norm(rig.centres - rig.centres.mean(0), axis=1).mean() or 1)
        self._nodes: list[viser.CameraFrustumHandle] = []
        self._names: list[viser.LabelHandle] = []
        for number, camera in enumerate(rig):
            width, height = camera.size
            node = scene.add_camera_frustum(
                f"/cameras/{number}",
                fov=2 * float(np.arctan2(height / 2, camera.K[1, 1])),
                aspect=width / height, scale=depth, color=(70, 110, 170),
                thickness=2.0, thickness_units="screen",
                wxyz=to_quaternion(camera.R.T), position=camera.centre,
            )  # fmt: skip
            self._nodes.append(node)
            self._names.append(scene.add_label(f"/cameras/{number}/name", camera.name))

    def show(self, pictures: list[np.ndarray]) -> None:
        """Show pictures (h, w, 3) uint8 RGB, one per camera."""
        for node, picture in zip(self._nodes, pictures, strict=True):
            node.image = picture

    def set_visible(self, shown: bool) -> None:
        """Show or hide all cameras."""
        for node in (*self._nodes, *self._names):
            node.visible = shown


def box_around(points: np.ndarray) -> Box:
    """Return the box of some points (..., 3) m, NaN where unknown, and what is near them."""
    flat = points.reshape(-1, 3)
    return np.nanmin(flat, axis=0) - _AROUND, np.nanmax(flat, axis=0) + _AROUND


def add_floor(scene: viser.SceneApi, box: Box) -> None:
    """Add the floor z = 0 under a box, in squares of 1, 0.1, ... m, with the world's axes, one
    square long."""
    low, high = box
    extent = (high - low)[:2]
    square = float(10.0 ** np.floor(np.log10(float(np.max(extent)))))
    middle = square * np.round((low + high)[:2] / (2 * square))
    width, height = 2 * square * np.ceil((extent / 2 + square) / square)
    scene.add_grid(
        "/floor", float(width), float(height), cell_size=square, section_size=square,
        position=(*middle, 0.0),
    )  # fmt: skip
    scene.add_frame("/axes", axes_length=square, axes_radius=0.01 * square)


class BoxNode:
    """The edges of a box, with a handle at two opposite corners by which it is dragged.

    corners: (2, 3) m. dragged: called with the corners after a handle was moved by a user.
    """

    def __init__(
        self,
        scene: viser.SceneApi,
        name: str,
        corners: np.ndarray,
        dragged: Callable[[np.ndarray], None],
    ) -> None:
        self._edges = scene.add_line_segments(
            name, NO_LINES, (120, 60, 160), thickness=2.0, thickness_units="screen"
        )
        self.handles = [
            scene.add_transform_controls(
                f"{name}/{number}", scale=_HANDLE, disable_rotations=True, depth_test=False,
                opacity=0.7,
            )
            for number in range(2)
        ]  # fmt: skip
        for handle in self.handles:
            handle.on_update(lambda event: dragged(np.stack([h.position for h in self.handles])))
        self.show(corners)

    def show(self, corners: np.ndarray) -> None:
        """Show the box between two corners (2, 3) m."""
        low, high = corners
        cube = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), -1).reshape(8, 3)
        pairs = [(a, b) for a in range(8) for b in range(a) if np.abs(cube[a] - cube[b]).sum() == 1]
        self._edges.points = (low + cube * (high - low))[np.array(pairs)].astype(np.float32)
        for handle, corner in zip(self.handles, corners, strict=True):
            handle.position = corner


def to_quaternion(rotation: np.ndarray) -> np.ndarray:
    """Return the unit quaternion (4,) w, x, y, z of a rotation (3, 3)."""
    return np.roll(scipy.spatial.transform.Rotation.from_matrix(rotation).as_quat(), 1)
