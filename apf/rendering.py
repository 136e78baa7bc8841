"""Rendering of all hypotheses in all cameras on the device (kernel: render.cl)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from apf.body import BodyModel, Cone
from apf.kinematics import Kinematics
from apf.meshes import BodyMesh
from cl import Array, Device, Launch
from psfs.camera import CameraRig

#: Work-items of a group, each at work on one row of a picture on a GPU; a CPU's single one takes
#: PACK rows in vectors, one lot after the other.
_ROWS, _PACK = 128, 8
#: 32-bit words of a Part in parts.h.
_PART_WORDS = 24
#: Work-items of a group that draws a mesh, and the words of local memory that it draws into.
_MESH_GROUP, _LOCAL_WORDS = 256, 7168


class FlatRenderer:
    """Draws the cones of `body` as trapezoids (Rymut 2016, 4.3) and counts their pixels.

    Cones that are not to be looked for in images cover their pixels, but show no edges.
    labels: (C,) int32 segment of each cone, from 0, for counts by segment. counts: device array
    (V, N, 2 + 2 L) int32 that the launches of `launcher` fill: visible edge pixels, the sum of the
    edge proximity there, then per segment the model's pixels and their overlap with the silhouette
    (eq. 4.36-4.40).
    """

    def __init__(
        self, device: Device, body: BodyModel, rig: CameraRig, n: int, labels: np.ndarray
    ) -> None:
        self.device, self.rig, self.n_hypotheses = device, rig, n
        self.n_parts, self.n_labels = len(body.cones), int(labels.max()) + 1
        self._kinematics = Kinematics(device, body, n)
        self._cameras = device.to_device(rig.packed(), "the cameras")
        edged = np.array([cone.in_images for cone in body.cones], np.int32)
        self._edged = device.to_device(edged, "the parts with edges")
        self._labels = device.to_device(labels.astype(np.int32), "the labels")
        shape = (len(rig), n, self.n_parts, _PART_WORDS)
        self._parts = device.empty(shape, np.float32, "the parts in the pictures")
        shape = (len(rig), n, 2 + 2 * self.n_labels)
        self.counts = device.empty(shape, np.int32, "the counted pixels")

    def launcher(
        self,
        poses: Array,
        roi: Array,
        silhouettes: Array,
        proximity: Array,
        pictures: Array | None = None,
    ) -> list[Launch]:
        """The launches that count `poses` (N, D), arguments set.

        roi: (V, 4) int32, ends excluded. silhouettes: uint32 of `silhouette_shape`, bit i of word w
        is pixel 32 w + i. proximity: (V, H, W) uint8. pictures: (N, V, H, W, 2) uint8, where given,
        gets the number of the part seen, from 1, and 255 on edges; nothing elsewhere.
        """
        rows, pack = (_ROWS, 1) if self.device.is_gpu else (1, _PACK)
        n, views = self.n_hypotheses, len(self.rig)
        place = self.device.launch(
            self.device.kernel("parts", "place_parts", N_PARTS=self.n_parts),
            (n * self.n_parts, views),
            (64, 1),
            np.int32(n),
            self._kinematics.cones,
            self._cameras,
            self._edged,
            self._parts,
        )
        defines = {"DRAW": 1} if pictures is not None else {}
        kernel = self.device.kernel(
            "render",
            "count_pixels",
            N_PARTS=self.n_parts,
            N_LABELS=self.n_labels,
            WIDTH=self.rig.width,
            GROUP=rows,
            PACK=pack,
            **defines,
        )
        count = self.device.launch(
            kernel,
            (n * rows, views),
            (rows, 1),
            np.int32(n),
            np.int32(self.rig.height),
            np.int32(silhouettes.shape[-1]),
            self._parts,
            roi,
            self._labels,
            silhouettes,
            proximity,
            self.counts,
            *(() if pictures is None else (pictures,)),
        )
        return [*self._kinematics.launcher(poses), place, count]


class MeshRenderer:
    """Draws a mesh that moves with the bones of `body`, as `FlatRenderer` draws cones.

    labels: (P,) int32 segment of each part of the mesh, from 0.
    """

    def __init__(
        self,
        device: Device,
        body: BodyModel,
        rig: CameraRig,
        n: int,
        labels: np.ndarray,
        mesh: BodyMesh,
    ) -> None:
        self.device, self.rig, self.n_hypotheses, self.mesh = device, rig, n, mesh
        self.n_labels = int(labels.max()) + 1
        self._kinematics = Kinematics(device, with_frames(body), n)
        self._cameras = device.to_device(rig.packed(), "the cameras")
        table = np.stack([labels, mesh.edged], -1).astype(np.int32)
        self._labels = device.to_device(table, "the labels")
        binds, bones = packed_binds(mesh)
        self._binds = device.to_device(binds, "the mesh's vertices")
        self._bones = device.to_device(bones, "the mesh's bones")
        triangles = np.column_stack([mesh.faces, mesh.parts]).astype(np.int32)
        self._triangles = device.to_device(triangles, "the mesh's triangles")
        self._n_corners = len(binds)
        shape = (len(rig), n, 2 + 2 * self.n_labels)
        self.counts = device.empty(shape, np.int32, "the counted pixels")
        pixels = (len(rig), n, self._n_corners, 2)
        self._pixels = device.empty(pixels, np.float32, "the projected vertices")

    def launcher(
        self,
        poses: Array,
        roi: Array,
        silhouettes: Array,
        proximity: Array,
        pictures: Array | None = None,
    ) -> list[Launch]:
        """As `FlatRenderer.launcher`."""
        n, group = self.n_hypotheses, _MESH_GROUP if self.device.is_gpu else 1
        drawn = () if pictures is None else (pictures,)
        project = self.device.launch(
            self._kernel("project_vertices", group, False),
            (self._n_corners, n, len(self.rig)),
            (min(64, self._n_corners), 1, 1),
            np.int32(n),
            self._kinematics.cones,
            self._cameras,
            self._binds,
            self._bones,
            self._pixels,
        )
        count = self.device.launch(
            self._kernel("count_pixels", group, bool(drawn)),
            (n * group, len(self.rig)),
            (group, 1),
            np.int32(n),
            np.int32(self.rig.height),
            np.int32(silhouettes.shape[-1]),
            self._pixels,
            self._triangles,
            roi,
            self._labels,
            silhouettes,
            proximity,
            self.counts,
            *drawn,
        )
        return [*self._kinematics.launcher(poses), project, count]

    def _kernel(self, name: str, group: int, drawn: bool) -> Any:
        words = -(-self.rig.width // 32) + 2
        least = 3 * words * self.mesh.n_parts  # a band of one row
        return self.device.kernel(
            "render_mesh",
            name,
            N_PARTS=self.mesh.n_parts,
            N_LABELS=self.n_labels,
            N_VERTICES=self.mesh.n_vertices,
            N_CORNERS=self._n_corners,
            N_BONES=len(self._kinematics.body.cones),
            N_TRIANGLES=len(self.mesh.faces),
            N_BINDS=self.mesh.bones.shape[1],
            CAPACITY=max(_LOCAL_WORDS, least),
            WIDTH=self.rig.width,
            GROUP=group,
            **({"DRAW": 1} if drawn else {}),
        )


def with_frames(body: BodyModel) -> BodyModel:
    """`body` with a cone for each of its bones that posed is the bone's frame: origin, first and
    second axis, and as its end the tip of the third."""
    zero, first, third = np.zeros(3), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    frames = tuple(
        Cone(bone.name, b, zero, third, (1.0, 1.0), first, (1.0, 1.0))
        for b, bone in enumerate(body.bones)
    )
    return replace(body, cones=frames, apart=())


def packed_binds(mesh: BodyMesh) -> tuple[np.ndarray, np.ndarray]:
    """Of vertices, then the parts' middles: (M + P, K, 4) float32 positions and weights, and
    (M + P, K) int32 bones."""
    middle_bones, middles = mesh.middles()
    n_binds = mesh.bones.shape[1]
    binds = np.zeros((mesh.n_vertices + mesh.n_parts, n_binds, 4), np.float32)
    bones = np.zeros((len(binds), n_binds), np.int32)
    binds[: mesh.n_vertices] = np.concatenate([mesh.positions, mesh.weights[..., None]], -1)
    bones[: mesh.n_vertices] = mesh.bones
    binds[mesh.n_vertices :, 0, :3], binds[mesh.n_vertices :, 0, 3] = middles, 1
    bones[mesh.n_vertices :, 0] = middle_bones
    return binds, bones


def renderer_for(
    device: Device,
    body: BodyModel,
    rig: CameraRig,
    n: int,
    labels: np.ndarray | None = None,
    mesh: BodyMesh | None = None,
) -> FlatRenderer | MeshRenderer:
    """What draws `n` poses: the body's cones as trapezoids or, where given, its mesh."""
    n_parts = len(body.cones) if mesh is None else mesh.n_parts
    labels = np.zeros(n_parts, np.int32) if labels is None else labels
    if mesh is None:
        return FlatRenderer(device, body, rig, n, labels)
    return MeshRenderer(device, body, rig, n, labels, mesh)


def draw_hypotheses(
    device: Device,
    body: BodyModel,
    rig: CameraRig,
    poses: np.ndarray,
    mesh: BodyMesh | None = None,
) -> np.ndarray:
    """Pictures (N, V, H, W, 2) uint8 of `poses` (N, D): the number of the part seen, from 1 (0 is
    background), and 255 on edges. The very pixels that an `ImageObjective` counts."""
    n, shape = len(poses), (len(rig), rig.height, rig.width)
    renderer = renderer_for(device, body, rig, n, mesh=mesh)
    pictures = device.zeros((n, *shape, 2), np.uint8, "the pictures")
    silhouettes = device.zeros(silhouette_shape(rig, 1), np.uint32, "the silhouettes")
    proximity = device.zeros(shape, np.uint8, "the edge proximity")
    roi = device.to_device(whole_pictures(rig), "the regions of interest")
    on_device = device.to_device(np.asarray(poses, np.float32), "the poses")
    for launch in renderer.launcher(on_device, roi, silhouettes, proximity, pictures):
        launch()
    return pictures.get()


def silhouette_shape(rig: CameraRig, n_labels: int) -> tuple[int, int, int, int]:
    """(V, L, words of a row, rows) of silhouettes as bits, with rows to spare for vectors."""
    return len(rig), n_labels, -(-rig.width // 32), rig.height + _PACK - 1


def whole_pictures(rig: CameraRig) -> np.ndarray:
    """(V, 4) int32 regions of interest that hold each camera's whole picture."""
    return np.array([(0, 0, *camera.size) for camera in rig], np.int32)
