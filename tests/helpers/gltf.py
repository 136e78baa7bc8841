"""What a GLB file holds."""

import numpy as np
import pygltflib
from scipy.spatial.transform import Rotation


def gltf_values(file: pygltflib.GLTF2, accessor: int) -> np.ndarray:
    entry = file.accessors[accessor]
    view = file.bufferViews[entry.bufferView]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[entry.type]
    kind = {5126: np.float32, 5121: np.uint8, 5125: np.uint32}[entry.componentType]
    blob = file.binary_blob()
    values = np.frombuffer(blob, kind, entry.count * width, view.byteOffset)
    return values.reshape(entry.count, width)


def gltf_nodes(file: pygltflib.GLTF2, frame: int) -> np.ndarray:
    """Return the world matrices (N, 4, 4) of the animated nodes in a frame."""
    parents = {child: index for index, node in enumerate(file.nodes) for child in node.children}
    moves = [(n.translation or [0, 0, 0], n.rotation or [0, 0, 0, 1]) for n in file.nodes]
    for channel in file.animations[0].channels:
        output = file.animations[0].samplers[channel.sampler].output
        value, node = gltf_values(file, output)[frame], channel.target.node
        place, turn = moves[node]
        moves[node] = (value, turn) if channel.target.path == "translation" else (place, value)

    def world(index: int) -> np.ndarray:
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat(moves[index][1]).as_matrix()
        matrix[:3, 3] = moves[index][0]
        return world(parents[index]) @ matrix if index in parents else matrix

    return np.array([world(index) for index in range(len(file.nodes))])
