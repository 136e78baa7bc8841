"""Rendering of all hypotheses in all cameras on the device (kernel: render.cl)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from apf.body.kinematics import posed_cones
from apf.body.mesh import BodyMesh
from apf.body.model import BodyModel, Cone
from apf.body.posing import CONE_DEFINES, Kinematics
from apf.scene import Scene
from cl import Array, InputError, Launch
from cl.workgroups import size_defines
from psfs.cameras.camera import CameraRig
from psfs.common.cones import cone_distances

#: Work-items of a group: on a GPU each processes one row of a picture; on a CPU a single work-item
#: processes _PACK rows at a time in vectors.
_ROWS, _PACK = 128, 8
#: 32-bit words of a Part in parts.h.
_PART_WORDS = 30
#: Largest width, px, that a span's signed 16 bits hold beside the value for an empty span.
_WIDEST = 16380
#: Local memory for the spans of a mesh's parts, bytes: small on a GPU, so that many groups run at
#: once.
_GPU_BYTES, _CPU_BYTES = 16384, 65536


class Renderer:
    """Renderer that draws posed bodies in all cameras and counts their pixels.

    It draws the cones of the scene's body, or a mesh that moves with them. counts: device array
    (V, N, 4) int32, written by the launches of `launcher`: visible edge pixels, the sum of the edge
    proximity there, the model's pixels, and their overlap with the silhouette (Rymut 2016 eq.
    4.36-4.40).
    """

    def __init__(self, scene: Scene, n: int, n_parts: int) -> None:
        device, body, rig = scene.opencl, scene.body, scene.rig
        self.device, self.rig, self.n_hypotheses = device, rig, n
        self.n_parts = n_parts
        self._kinematics = Kinematics(device, body, n)
        self._cameras = device.to_device(rig.packed(), "the cameras")
        self.counts = device.empty((len(rig), n, 4), np.int32, "the counted pixels")

    def launcher(
        self,
        poses: Array,
        roi: Array,
        silhouettes: Array,
        proximity: Array,
        pictures: Array | None = None,
    ) -> list[Launch]:
        """Return the launches that draw `poses` (N, D) float32 and count their pixels.

        roi: (V, 4) int32, ends excluded. silhouettes: uint32 of `silhouette_shape`, bit i of word w
        is pixel 32 w + i. proximity: (V, H, W) uint8. pictures: (N, V, H, W, 2) uint8; if given,
        the kernel writes the number of the visible part, from 1, and 255 on edges, and leaves all
        other pixels as they are.
        """
        rows, pack = (_ROWS, 1) if self.device.is_gpu else (1, _PACK)
        stage, shapes, defines = self._shapes()
        kernel = self.device.kernel(
            stage,
            "count_pixels",
            N_PARTS=self.n_parts,
            **size_defines(self.device, self.rig.picture),
            GROUP=rows,
            PACK=pack,
            **({} if pictures is None else {"DRAW": 1}),
            **CONE_DEFINES,
            **defines,
        )
        count = self.device.launch(
            kernel,
            (self.n_hypotheses * rows, len(self.rig)),
            (rows, 1),
            n_particles=self.n_hypotheses,
            **shapes,
            picture=self.rig.picture,
            pitch=silhouettes.shape[-1],
            roi=roi,
            silhouettes=silhouettes,
            proximity=proximity,
            counts=self.counts,
            pictures=pictures,
        )
        return [*self._kinematics.launcher(poses), self._projection(), count]

    def _projection(self) -> Launch:
        """Return the launch that projects the posed body into the pictures."""
        raise NotImplementedError

    def _shapes(self) -> tuple[str, dict[str, Array], dict[str, int]]:
        """Return the stage of the counting kernel, and its additional arguments and defines."""
        raise NotImplementedError


class FlatRenderer(Renderer):
    """Renderer of the body's cones as trapezoids (Rymut 2016, 4.3).

    round_ends: draw the round ends that cones have in the voxel likelihood. Cones that are not
    compared with images (`in_images` is False) cover pixels but have no edges.
    """

    def __init__(
        self,
        scene: Scene,
        n: int,
        round_ends: bool = False,
    ) -> None:
        super().__init__(scene, n, len(scene.body.cones))
        device, body, rig = self.device, scene.body, scene.rig
        self.round_ends = round_ends
        edged, free = cone_edges(body)
        table = np.stack([edged, free @ [1, 2]], -1).astype(np.int32)
        self._edged = device.to_device(table, "the parts with edges")
        shape = (len(rig), n, self.n_parts, _PART_WORDS)
        self._parts = device.empty(shape, np.float32, "the parts in the pictures")

    def _projection(self) -> Launch:
        kernel = self.device.kernel(
            "image/parts",
            "place_parts",
            N_PARTS=self.n_parts,
            PART_WORDS=_PART_WORDS,
            ROUND_ENDS=int(self.round_ends),
            **self.rig.defines,
            **CONE_DEFINES,
        )
        return self.device.launch(
            kernel,
            (self.n_hypotheses * self.n_parts, len(self.rig)),
            (64, 1),
            n_particles=self.n_hypotheses,
            cones=self._kinematics.cones,
            cameras=self._cameras,
            edged=self._edged,
            parts=self._parts,
        )

    def _shapes(self) -> tuple[str, dict[str, Array], dict[str, int]]:
        return "image/render", {"all_parts": self._parts}, {"PART_WORDS": _PART_WORDS}


class MeshRenderer(Renderer):
    """Renderer of a mesh that moves with the body's bones."""

    def __init__(
        self,
        scene: Scene,
        n: int,
        mesh: BodyMesh,
    ) -> None:
        super().__init__(replace(scene, body=with_frames(scene.body)), n, mesh.n_parts)
        device, rig = self.device, scene.rig
        self.mesh = mesh
        self._edged = device.to_device(mesh.edged.astype(np.int32), "the parts with edges")
        binds, bones = packed_binds(mesh)
        self._binds = device.to_device(binds, "the mesh's vertices")
        self._bones = device.to_device(bones, "the mesh's bones")
        lines, owners = mesh.lines()
        self._lines = device.to_device(lines, "the mesh's lines")
        self._owners = device.to_device(owners, "the mesh's lines")
        self._sizes = {"N_VERTICES": mesh.n_vertices, "N_CORNERS": len(binds)}
        pixels = (len(rig), n, len(binds), 2)
        self._pixels = device.empty(pixels, np.float32, "the projected vertices")

    def _projection(self) -> Launch:
        kernel = self.device.kernel(
            "image/skin",
            "project_vertices",
            N_BONES=len(self._kinematics.body.cones),
            N_BINDS=self.mesh.bones.shape[1],
            **self.rig.defines,
            **self._sizes,
            **CONE_DEFINES,
        )
        n_corners = self._sizes["N_CORNERS"]
        return self.device.launch(
            kernel,
            (n_corners, self.n_hypotheses, len(self.rig)),
            (min(64, n_corners), 1, 1),
            n_particles=self.n_hypotheses,
            frames=self._kinematics.cones,
            cameras=self._cameras,
            binds=self._binds,
            bind_bones=self._bones,
            pixels=self._pixels,
        )

    def _shapes(self) -> tuple[str, dict[str, Array], dict[str, int]]:
        room = _GPU_BYTES if self.device.is_gpu else _CPU_BYTES
        band = max(1, room // (8 * self.n_parts) - 2 - _PACK)
        bands = {"N_LINES": self._lines.shape[0], "BAND": min(band, self.rig.height)}
        arrays = {"all_pixels": self._pixels, "lines": self._lines, "owners": self._owners}
        arrays["edged"] = self._edged
        return "image/render_mesh", arrays, {**self._sizes, **bands}


def cone_edges(body: BodyModel) -> tuple[np.ndarray, np.ndarray]:
    """Return which cones show edges (C,), and which of their round ends do (C, 2): both bool.

    An end is free, not a joint, if its tip lies outside of all other cones when the body stands.
    """
    cones = posed_cones(body, body.rest_pose[None])[0]
    free = np.zeros((len(cones), 2), bool)
    for c, cone in enumerate(cones):
        axis = (cone[4:7] - cone[0:3]) / np.linalg.norm(cone[4:7] - cone[0:3])
        tips = np.stack([cone[0:3] - cone[3] * axis, cone[4:7] + cone[7] * axis])
        free[c] = (cone_distances(tips, np.delete(cones, c, 0)) > 0).all(1)
    return np.array([cone.in_images for cone in body.cones]), free


def with_frames(body: BodyModel) -> BodyModel:
    """Return `body` with one cone per bone that, when posed, holds the bone's frame: origin, first
    and second axis, and the tip of the third axis as the cone's end."""
    zero, first, third = np.zeros(3), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    frames = tuple(
        Cone(bone.name, b, zero, third, (1.0, 1.0), first, (1.0, 1.0))
        for b, bone in enumerate(body.bones)
    )
    return replace(body, cones=frames, apart=())


def packed_binds(mesh: BodyMesh) -> tuple[np.ndarray, np.ndarray]:
    """Pack the skinning data of M vertices and then of P part centres: (M + P, K, 4) float32
    positions and weights, and (M + P, K) int32 bones."""
    middle_bones, middles = mesh.middles
    n_binds = mesh.bones.shape[1]
    binds = np.zeros((mesh.n_vertices + mesh.n_parts, n_binds, 4), np.float32)
    bones = np.zeros((len(binds), n_binds), np.int32)
    binds[: mesh.n_vertices] = np.concatenate([mesh.positions, mesh.weights[..., None]], -1)
    bones[: mesh.n_vertices] = mesh.bones
    binds[mesh.n_vertices :, 0, :3], binds[mesh.n_vertices :, 0, 3] = middles, 1
    bones[mesh.n_vertices :, 0] = middle_bones
    return binds, bones


def make_renderer(
    scene: Scene,
    n: int,
    mesh: BodyMesh | None = None,
    round_ends: bool = False,
) -> Renderer:
    """Return the renderer of `n` poses: of `mesh`, or of the body's cones if that is None.

    Raises InputError if the pictures are too wide.
    """
    if scene.rig.width > _WIDEST:
        raise InputError(f"pictures {scene.rig.width} px wide; expected at most {_WIDEST}")
    return FlatRenderer(scene, n, round_ends) if mesh is None else MeshRenderer(scene, n, mesh)


def draw_hypotheses(
    scene: Scene,
    poses: np.ndarray,
    mesh: BodyMesh | None = None,
    round_ends: bool = False,
) -> np.ndarray:
    """Draw `poses` (N, D) into pictures (N, V, H, W, 2) uint8, with exactly the pixels that an
    `ImageObjective` counts.

    Channel 0 is the number of the visible part, from 1 (0 is background); channel 1 is 255 on
    edges.
    """
    device, rig = scene.opencl, scene.rig
    n, shape = len(poses), (len(rig), rig.height, rig.width)
    renderer = make_renderer(scene, n, mesh=mesh, round_ends=round_ends)
    pictures = device.zeros((n, *shape, 2), np.uint8, "the pictures")
    silhouettes = device.zeros(silhouette_shape(rig), np.uint32, "the silhouettes")
    proximity = device.zeros(shape, np.uint8, "the edge proximity")
    roi = device.to_device(whole_pictures(rig), "the regions of interest")
    on_device = device.to_device(np.asarray(poses, np.float32), "the poses")
    for launch in renderer.launcher(on_device, roi, silhouettes, proximity, pictures):
        launch()
    return pictures.get()


def silhouette_shape(rig: CameraRig) -> tuple[int, int, int]:
    """Return (V, words of a row, rows) of silhouettes as bits, with spare rows for vectors."""
    return len(rig), -(-rig.width // 32), rig.height + _PACK - 1


def whole_pictures(rig: CameraRig) -> np.ndarray:
    """Return (V, 4) int32 regions of interest that hold each camera's whole picture."""
    return np.array([(0, 0, *camera.size) for camera in rig], np.int32)
