"""Nodes of the page's 3-D view: bodies, voxels, cameras, the floor; one class each."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from apf.body.kinematics import bone_matrices, posed_joints
from apf.body.limbs import limb_bones, limb_ends
from apf.body.mesh import cone_mesh
from apf.report.scene_colours import LOST, colour_by_side, colour_edges
from apf.studio.clouds import Points, grid_centre
from apf.tracking.track import Track
from psfs.cameras.camera import CameraRig
from psfs.mesh.drawing import draw_floor
from psfs.voxels.grid import VoxelGrid

if TYPE_CHECKING:
    import viser

_VERTICES_PER_CONE = 18
_BONE_WIDTH, _TRAIL_WIDTH = 4.0, 2.0  # px
_JOINT_SIZE, _HANDLE = 0.03, 0.8  # m
_NO_LINES = np.zeros((1, 2, 3), np.float32)


class BodyNodes:
    """A track's body in one frame: cones, skeleton, joints, and trails of the limbs' ends.

    scene: viser's. name: of the node that holds all others.
    """

    def __init__(self, scene: viser.SceneApi, name: str, track: Track) -> None:
        self._track, body = track, track.its_body
        self._limb_bones, self.ends = limb_bones(body), limb_ends(body)
        self._lost, self._lost_limbs = track.lost, track.lost_limbs  # computed at each call
        self._edge_colours = colour_edges(track)
        self._root = scene.add_frame(name, show_axes=False)
        self._bones = [
            scene.add_frame(f"{name}/{b}", show_axes=False) for b in range(len(body.bones))
        ]
        self.cones: list[viser.MeshHandle] = []
        self._cone_colours = colour_by_side(body.cone_names).tolist()
        self._cone_bones = np.array([cone.bone for cone in body.cones])
        mesh = cone_mesh(body, _VERTICES_PER_CONE)
        for number, cone in enumerate(body.cones):
            faces = mesh.faces[mesh.parts == number]
            used, corners = np.unique(faces, return_inverse=True)
            self.cones.append(
                scene.add_mesh_simple(
                    f"{name}/{cone.bone}/cone{number}",
                    mesh.positions[used, 0],
                    corners.reshape(-1, 3),
                    color=self._cone_colours[number],
                    opacity=0.55,
                )
            )
        self._shown_lost, self._with_trails = np.zeros(len(body.cones), bool), True
        self.skeleton = scene.add_line_segments(
            f"{name}/skeleton", np.zeros((len(track.edges), 2, 3), np.float32),
            np.zeros((len(track.edges), 2, 3), np.uint8), thickness=_BONE_WIDTH,
            thickness_units="screen",
        )  # fmt: skip
        self.joints = scene.add_point_cloud(
            f"{name}/joints", track.joints[0].astype(np.float32), (250, 250, 250),
            point_size=_JOINT_SIZE, point_shape="circle", precision="float32",
        )  # fmt: skip
        self.trails = scene.add_line_segments(
            f"{name}/trails", _NO_LINES, np.zeros((1, 2, 3), np.uint8), thickness=_TRAIL_WIDTH,
            thickness_units="screen",
        )  # fmt: skip

    def show(self, row: int, trail_rows: int) -> None:
        """Show a row of the track, with trails of the rows before it."""
        track = self._track
        self._place_bones(track.poses[row])
        lost = bool(self._lost[row])
        lost_bones = (self._lost_limbs[row] @ self._limb_bones).astype(bool) | lost
        self._colour_cones(lost_bones[self._cone_bones])
        self._place_joints(track.joints[row])
        colours = np.where(lost, np.array(LOST, np.uint8), self._edge_colours)
        self.skeleton.colors = np.repeat(colours[:, None], 2, axis=1)
        self._show_trails(row, trail_rows)

    def set_visible(self, shown: bool) -> None:
        """Show or hide the whole body."""
        self._root.visible = shown

    def show_pose(self, pose: np.ndarray) -> None:
        """Show a pose (D,) of the body until the next row is shown."""
        self._place_bones(pose)
        self._place_joints(posed_joints(self._track.its_body, pose[None])[0])

    def _place_bones(self, pose: np.ndarray) -> None:
        rotations, origins = (each[0] for each in bone_matrices(self._track.its_body, pose[None]))
        for node, rotation, origin in zip(self._bones, rotations, origins, strict=True):
            node.wxyz, node.position = to_quaternion(rotation), origin

    def _place_joints(self, joints: np.ndarray) -> None:
        self.skeleton.points = joints[self._track.edges].astype(np.float32)
        self.joints.points = joints.astype(np.float32)

    def set_trails(self, shown: bool) -> None:
        """Draw trails from the next frame on, or none."""
        self._with_trails = shown

    def _colour_cones(self, lost: np.ndarray) -> None:
        for number in np.flatnonzero(lost != self._shown_lost):
            self.cones[number].color = LOST if lost[number] else self._cone_colours[number]
        self._shown_lost = lost

    def _show_trails(self, row: int, rows: int) -> None:
        past = self._track.joints[max(0, row - rows) : row + 1][:, self.ends].astype(np.float32)
        if len(past) < 2 or not self.ends or not self._with_trails:
            self.trails.visible = False
            return
        lines = np.stack([past[:-1], past[1:]], axis=2).reshape(-1, 2, 3)
        sides = colour_by_side(self._track.joint_names[end] for end in self.ends)
        colours = np.tile(sides, (len(past) - 1, 1))
        self.trails.points, self.trails.visible = lines, True
        self.trails.colors = np.repeat(colours[:, None], 2, axis=1)


class VoxelNode:
    """The surface voxels of one frame as points."""

    def __init__(self, scene: viser.SceneApi, grid: VoxelGrid) -> None:
        self._node = scene.add_point_cloud(
            "/voxels", np.zeros((1, 3), np.float16), np.zeros((1, 3), np.uint8),
            point_size=grid.voxel_size, point_shape="square", point_shading="flat",
            position=grid_centre(grid), visible=False,
        )  # fmt: skip
        self._points: Points | None = None

    def show(self, points: Points | None) -> None:
        """Show these points; nothing for None."""
        if points is self._points:
            return
        self._points = points
        if points is not None and len(points.positions):
            self._node.points, self._node.colors = points.positions, points.colours
            self._node.point_size = points.size
        self._node.visible = points is not None and len(points.positions) > 0


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


def add_floor(scene: viser.SceneApi, grid: VoxelGrid) -> None:
    """Add the floor z = 0 under a grid, in squares of 1, 0.1, ... m, with the world's axes."""
    floor = draw_floor(grid)
    scene.add_line_segments(
        "/floor", floor.points[floor.pairs].astype(np.float32),
        np.repeat(floor.colours[:, None], 2, axis=1), thickness=1.0, thickness_units="screen",
    )  # fmt: skip


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
            name, _NO_LINES, (120, 60, 160), thickness=2.0, thickness_units="screen"
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
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    quaternion: np.ndarray = trimesh.transformations.quaternion_from_matrix(matrix)
    return quaternion
