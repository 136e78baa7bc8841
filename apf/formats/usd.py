"""Write USD, Universal Scene Description, as text (.usda): a person's surface, skinned by UsdSkel.

Metres, Y up, (X, Y, Z) = world (x, z, -y), a time code per frame. Matrices multiply row vectors.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from apf.body.mesh import MAX_BONES
from apf.body.surface import Surface
from apf.formats.glb import make_quaternions, row_matrices
from apf.formats.motion import BodyMotion
from apf.formats.skeleton import TO_Y_UP, build_skeleton
from psfs.common.files import write_text
from psfs.mesh.marching_cubes import to_linear

_FILE = """#usda 1.0
(
    defaultPrim = "Person"
    endTimeCode = {last}
    metersPerUnit = 1
    startTimeCode = {first}
    timeCodesPerSecond = {fps:g}
    upAxis = "Y"
)

def SkelRoot "Person"
{{
    def Skeleton "Skeleton" (
        prepend apiSchemas = ["SkelBindingAPI"]
    )
    {{
        uniform matrix4d[] bindTransforms = {bind}
        uniform token[] joints = {joints}
        uniform matrix4d[] restTransforms = {rest}
        rel skel:animationSource = </Person/Motion>
    }}

    def SkelAnimation "Motion"
    {{
        uniform token[] joints = {joints}
        quatf[] rotations.timeSamples = {{{rotations}
        }}
        half3[] scales = {scales}
        float3[] translations.timeSamples = {{{translations}
        }}
    }}

    def Mesh "Surface" (
        prepend apiSchemas = ["SkelBindingAPI"]
    )
    {{
        int[] faceVertexCounts = {counts}
        int[] faceVertexIndices = {indices}
        point3f[] points = {points}{colours}
        matrix4d primvars:skel:geomBindTransform = {identity}
        int[] primvars:skel:jointIndices = {owners} (
            elementSize = {width}
            interpolation = "vertex"
        )
        float[] primvars:skel:jointWeights = {weights} (
            elementSize = {width}
            interpolation = "vertex"
        )
        rel skel:skeleton = </Person/Skeleton>
        uniform token subdivisionScheme = "none"
    }}
}}
"""
_COLOURS = """
        color3f[] primvars:displayColor = {} (
            interpolation = "vertex"
        )"""


def write_usd(path: str | Path, motion: BodyMotion, surface: Surface) -> None:
    """Write the animated surface. Raises InputError if the file cannot be written."""
    body, skeleton = motion.body, build_skeleton(motion.body)
    bone_of = {k: node.bone for k, node in enumerate(skeleton.nodes) if node.bone is not None}
    nodes, bones = list(bone_of), list(bone_of.values())
    names: dict[int, str] = {}
    for node in nodes:
        parent = skeleton.nodes[node].parent
        above = f"{names[parent]}/" if parent in names else ""
        names[node] = above + skeleton.nodes[node].name
    rotations, positions = (values[:, nodes] for values in skeleton.motion(body, motion.poses))
    quaternions = [make_quaternions(rotations[:, k])[:, [3, 0, 1, 2]] for k in range(len(nodes))]
    bound = skeleton.motion(body, surface.pose[None])
    mesh = surface.bind(body)
    width = min(MAX_BONES, mesh.bones.shape[1])
    frames = motion.points.frames.tolist()
    colours = _COLOURS.format(_array(to_linear(surface.colours / 255)))
    text = _FILE.format(
        first=frames[0] if frames else 0,
        last=frames[-1] if frames else 0,
        fps=motion.points.fps,
        joints="[" + ", ".join(f'"{name}"' for name in names.values()) + "]",
        bind=_array(row_matrices(*skeleton.bind(body, surface.pose, bones))),
        rest=_array(row_matrices(bound[1][0, nodes], bound[0][0, nodes])),
        rotations=_samples(frames, np.stack(quaternions, 1)),
        translations=_samples(frames, positions),
        scales=_array(np.ones((len(nodes), 3))),
        counts=_array(np.full(len(surface.faces), 3)),
        indices=_array(surface.faces.ravel()),
        points=_array(surface.vertices @ TO_Y_UP.T),
        colours=colours if len(surface.colours) else "",
        identity=_array(np.eye(4)).replace("[", "(").replace("]", ")"),
        owners=_array(np.argsort(bones)[mesh.bones].ravel()),
        weights=_array(mesh.weights.ravel()),
        width=width,
    )
    write_text(path, text)


def _samples(frames: Iterable[int], values: np.ndarray) -> str:
    """Return an array per time code."""
    lines = zip(frames, values, strict=True)
    return "".join(f"\n            {frame}: {_array(of)}," for frame, of in lines)


def _array(values: np.ndarray) -> str:
    """Return an array as USD writes it: its last axes as tuples."""

    def write(row: Any) -> str:
        return f"({', '.join(map(write, row))})" if isinstance(row, list) else f"{row:.7g}"

    return f"[{', '.join(map(write, np.asarray(values).tolist()))}]"
