"""Write GLB, binary glTF 2.0: a skinned mesh that the body's skeleton moves: its cones, or the
person's own surface in its colours.

Metres, Y up, (X, Y, Z) = world (x, z, -y), as the surfaces of `psfs mesh`; rotations as
quaternions. Blender and browsers play it. Lost frames repeat the pose before them, lost limbs are
interpolated; the animation's `extras` list both.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from apf.body.limbs import limb_names
from apf.body.mesh import MAX_BONES, BodyMesh, rounded_mesh
from apf.body.model import find_side
from apf.body.surface import Surface, normals
from apf.formats.bvh import is_translating
from apf.formats.motion import BodyMotion
from apf.formats.skeleton import Skeleton, build_skeleton
from psfs.common.files import write_atomically
from psfs.mesh.marching_cubes import to_linear

#: Colours of the left side, the right side and the rest, linear RGBA.
_COLOURS = {
    "left": (0.10, 0.30, 0.75, 1.0),
    "right": (0.75, 0.20, 0.10, 1.0),
    "middle": (0.6, 0.6, 0.6, 1.0),
}


def write_glb(path: str | Path, motion: BodyMotion, surface: Surface | None = None) -> None:
    """Write the animated body: its cones in the rest attitude, or the `surface` in its pose. Raises
    InputError if the file cannot be written."""
    body, skeleton, file = motion.body, build_skeleton(motion.body), _File()
    bone_of = {k: node.bone for k, node in enumerate(skeleton.nodes) if node.bone is not None}
    nodes, bones = list(bone_of), list(bone_of.values())
    _add_nodes(file, skeleton, motion)
    if surface is None:
        mesh, colours = rounded_mesh(body), np.zeros((0, 3))
        origins, turned = skeleton.places()[nodes], np.tile(np.eye(3), (len(nodes), 1, 1))
    else:
        mesh, colours = surface.bind(body), surface.colours
        origins, turned = skeleton.bind(body, surface.pose, bones)
    back = row_matrices(-np.einsum("jab,ja->jb", turned, origins), turned.swapaxes(1, 2))
    bind = file.add(back.astype(np.float32), "MAT4")
    file.model["skins"] = [{"joints": nodes, "inverseBindMatrices": bind}]
    _add_mesh(file, skeleton, bones, mesh, (origins, turned), colours)
    if len(motion.poses):
        _add_animation(file, skeleton, motion)
    with write_atomically(path) as temporary:
        temporary.write_bytes(file.content())


#: Codes of glTF 2.0, section 3.6.2: component types, and targets of a buffer's views.
_COMPONENTS = {"f4": 5126, "u4": 5125, "u1": 5121}
_VERTICES, _INDICES = 34962, 34963


class _File:
    """A glTF model, as the dictionary of its JSON, and the bytes of its one buffer."""

    def __init__(self) -> None:
        self.model: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "psfs-apf"},
            "bufferViews": [],
            "accessors": [],
        }
        self._bytes = bytearray()

    def add(self, values: np.ndarray, kind: str, target: int | None = None) -> int:
        """Add values (N, ...), float32 or unsigned, return their accessor; kind: such as VEC3."""
        data = np.ascontiguousarray(values)
        flat = data.reshape(len(data), -1)
        self._bytes.extend(b"\0" * (-len(self._bytes) % 4))
        view = {"buffer": 0, "byteOffset": len(self._bytes), "byteLength": data.nbytes}
        self._bytes.extend(data.tobytes())
        self.model["bufferViews"].append(view | ({"target": target} if target else {}))
        self.model["accessors"].append(
            {
                "bufferView": len(self.model["bufferViews"]) - 1,
                "componentType": _COMPONENTS[data.dtype.str[1:]],
                "count": len(data),
                "type": kind,
                "min": flat.min(0).tolist(),
                "max": flat.max(0).tolist(),
            }
        )
        return len(self.model["accessors"]) - 1

    def content(self) -> bytes:
        """Return the bytes of the whole file: a header, a chunk of JSON, a chunk of numbers."""
        self.model["buffers"] = [{"byteLength": len(self._bytes)}]
        text = json.dumps(self.model).encode()
        text += b" " * (-len(text) % 4)
        data = self._bytes + b"\0" * (-len(self._bytes) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _add_nodes(file: _File, skeleton: Skeleton, motion: BodyMotion) -> None:
    """Add the nodes in their first frame's pose, and then the node of the mesh."""
    first = motion.poses[:1] if len(motion.poses) else motion.body.rest_pose[None]
    rotations, positions = skeleton.motion(motion.body, first)
    turned = make_quaternions(rotations[0])
    nodes = [
        {
            "name": node.name,
            "translation": positions[0, index].tolist(),
            "rotation": turned[index].tolist(),
        }
        | ({"children": children} if (children := skeleton.children(index)) else {})
        for index, node in enumerate(skeleton.nodes)
    ]
    roots = [index for index, node in enumerate(skeleton.nodes) if node.parent < 0]
    nodes.append({"name": f"{motion.body.name} body", "mesh": 0, "skin": 0})
    file.model |= {"nodes": nodes, "scene": 0, "scenes": [{"nodes": [*roots, len(nodes) - 1]}]}


def _add_mesh(
    file: _File,
    skeleton: Skeleton,
    bones: list[int],
    mesh: BodyMesh,
    frames: tuple[np.ndarray, np.ndarray],
    colours: np.ndarray,
) -> None:
    """Add a mesh, bound to its `bones` in frames of these origins (J, 3) and rotations (J, 3, 3):
    in its colours (M, 3) uint8, or, without, one primitive per side."""
    joint_of = np.argsort(bones).astype(np.uint8)
    joints, weights = joint_of[mesh.bones], mesh.weights.astype(np.float32)
    origins, turned = (values[joints[:, 0]] for values in frames)
    turned = turned @ skeleton.rest[mesh.bones[:, 0]]
    points = origins + np.einsum("vab,vb->va", turned, mesh.positions[:, 0])
    spare = ((0, 0), (0, MAX_BONES - mesh.bones.shape[1]))
    attributes = {
        "POSITION": file.add(points.astype(np.float32), "VEC3", _VERTICES),
        "NORMAL": file.add(normals(points, mesh.faces), "VEC3", _VERTICES),
        "JOINTS_0": file.add(np.pad(joints * (weights > 0), spare), "VEC4", _VERTICES),
        "WEIGHTS_0": file.add(np.pad(weights, spare), "VEC4", _VERTICES),
    }
    primitives: list[dict[str, Any]] = []
    materials: list[dict[str, Any]] = []
    sides = np.array([find_side(name) for name in mesh.names])[mesh.parts]
    chosen = _COLOURS
    if len(colours):
        linear = to_linear(colours / 255).astype(np.float32)
        attributes["COLOR_0"] = file.add(linear, "VEC3", _VERTICES)
        sides[:], chosen = "person", {"person": (1.0, 1.0, 1.0, 1.0)}
    for side, colour in chosen.items():
        faces = mesh.faces[sides == side]
        if not len(faces):
            continue
        indices = file.add(faces.reshape(-1).astype(np.uint32), "SCALAR", _INDICES)
        shine = {"baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 0.8}
        primitives.append(
            {"attributes": attributes, "indices": indices, "material": len(materials)}
        )
        materials.append({"name": side, "pbrMetallicRoughness": shine})
    file.model |= {"meshes": [{"name": "body", "primitives": primitives}], "materials": materials}


def _add_animation(file: _File, skeleton: Skeleton, motion: BodyMotion) -> None:
    """Add a channel for the rotation of every bone, and for the position of those that
    translate."""
    rotations, positions = skeleton.motion(motion.body, motion.poses)
    points = motion.points
    times = file.add((points.times - points.times[0]).astype(np.float32), "SCALAR")
    limbs = {
        name: points.frames[column].tolist()
        for name, column in zip(limb_names(motion.body), motion.lost_limbs.T, strict=True)
        if column.any()
    }
    lost = points.frames[motion.lost].tolist()
    extras = {"lost_frames": lost, "lost_limbs": limbs, "note": points.note}
    samplers: list[dict[str, Any]] = []
    channels = []
    for index, node in enumerate(skeleton.nodes):
        if node.bone is None:
            continue
        curves = {"rotation": make_quaternions(rotations[:, index])}
        if is_translating(motion.body, node.bone):
            curves["translation"] = positions[:, index]
        for path, curve in curves.items():
            values = file.add(curve.astype(np.float32), f"VEC{curve.shape[1]}")
            target = {"node": index, "path": path}
            channels.append({"sampler": len(samplers), "target": target})
            samplers.append({"input": times, "output": values, "interpolation": "LINEAR"})
    file.model["animations"] = [
        {"name": "motion", "samplers": samplers, "channels": channels, "extras": extras}
    ]


def row_matrices(shifts: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """Return matrices (J, 4, 4) for row vectors, which are those for columns by columns, of
    rotations (J, 3, 3) and then shifts (J, 3)."""
    matrices = np.tile(np.eye(4), (len(shifts), 1, 1))
    matrices[:, :3, :3], matrices[:, 3, :3] = rotations.swapaxes(1, 2), shifts
    return matrices


def make_quaternions(rotations: np.ndarray) -> np.ndarray:
    """Return unit quaternions (F, 4), x y z w, of rotations (F, 3, 3), without sign changes."""
    from scipy.spatial.transform import Rotation

    quaternions = Rotation.from_matrix(rotations).as_quat()
    turns = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0
    quaternions[1:] *= np.where(np.cumsum(turns) % 2, -1.0, 1.0)[:, None]
    return quaternions
