"""A tracked body in the page's 3-D view."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from apf.body.kinematics import bone_matrices, posed_joints
from apf.body.limbs import limb_ends
from apf.body.mesh import cone_mesh
from apf.report.drawing import Figure
from psfs.page.nodes import NO_LINES, to_quaternion

if TYPE_CHECKING:
    import viser

_VERTICES_PER_CONE = 18
_BONE_WIDTH, _TRAIL_WIDTH = 4.0, 2.0  # px
_JOINT_SIZE = 0.03  # m


class BodyNodes:
    """A figure in one frame: cones, skeleton, joints, and trails of the limbs' ends.

    scene: viser's. name: of the node that holds all others.
    """

    def __init__(self, scene: viser.SceneApi, name: str, figure: Figure) -> None:
        self.figure, track = figure, figure.track
        self._track, body = track, track.its_body
        self.ends = limb_ends(body)
        self._root = scene.add_frame(name, show_axes=False)
        self._bones = [
            scene.add_frame(f"{name}/{b}", show_axes=False) for b in range(len(body.bones))
        ]
        self.cones: list[viser.MeshHandle] = []
        self._colours = figure.colour_cones(0)
        mesh = cone_mesh(body, _VERTICES_PER_CONE)
        for number, cone in enumerate(body.cones):
            faces = mesh.faces[mesh.parts == number]
            used, corners = np.unique(faces, return_inverse=True)
            self.cones.append(
                scene.add_mesh_simple(
                    f"{name}/{cone.bone}/cone{number}",
                    mesh.positions[used, 0],
                    corners.reshape(-1, 3),
                    color=tuple(self._colours[number].tolist()),
                    opacity=0.55,
                )
            )
        #: Whether trails are drawn from the next frame on.
        self.with_trails = True
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
            f"{name}/trails", NO_LINES, np.zeros((1, 2, 3), np.uint8), thickness=_TRAIL_WIDTH,
            thickness_units="screen",
        )  # fmt: skip

    def show(self, row: int, trail_rows: int) -> None:
        """Show a row of the track, with trails of the rows before it."""
        track, figure = self._track, self.figure
        self._place_bones(track.poses[row])
        colours = figure.colour_cones(row)
        for number in np.flatnonzero((colours != self._colours).any(axis=1)):
            self.cones[number].color = tuple(colours[number].tolist())
        self._colours = colours
        self._place_joints(track.joints[row])
        self.skeleton.colors = np.repeat(figure.colour_edges(row)[:, None], 2, axis=1)
        past = track.joints[max(0, row - trail_rows) : row + 1][:, self.ends].astype(np.float32)
        if len(past) < 2 or not self.ends or not self.with_trails:
            self.trails.visible = False
            return
        lines = np.stack([past[:-1], past[1:]], axis=2).reshape(-1, 2, 3)
        colours = np.tile(figure.colour_joints(self.ends), (len(past) - 1, 1))
        self.trails.points, self.trails.visible = lines, True
        self.trails.colors = np.repeat(colours[:, None], 2, axis=1)

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
