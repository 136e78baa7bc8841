"""Write BVH files, the animation format of Blender, MotionBuilder and most others.

Centimetres and degrees, Y up; every joint's rotation as Zrotation Xrotation Yrotation, whose
matrices are multiplied from left to right. A file has neither times nor gaps: lost or omitted
frames repeat the pose before them, lost limbs are interpolated.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from apf.body.angles import decompose
from apf.body.model import BodyModel
from apf.formats.motion import BodyMotion
from apf.formats.skeleton import Skeleton, build_skeleton
from psfs.common.files import open_text

_TURNS = "Zrotation Xrotation Yrotation"
_SHIFTS = "Xposition Yposition Zposition"
#: Length of the end site of a joint without children, cm.
_STUB = 5.0


def write_bvh(path: str | Path, motion: BodyMotion) -> None:
    """Write hierarchy and motion. Raises InputError if the file cannot be written."""
    skeleton = build_skeleton(motion.body)
    rate, rows = motion.points.to_constant_rate()
    rows = np.maximum.accumulate(rows)
    rotations, positions = skeleton.motion(motion.body, motion.poses)
    lines = ["HIERARCHY"]
    columns: list[np.ndarray] = []
    for index, node in enumerate(skeleton.nodes):
        if node.parent < 0:
            lines += _format_node(skeleton, motion.body, index, 0)
        if not is_end(skeleton, index):
            if is_translating(motion.body, node.bone):
                columns.append(100 * positions[:, index])
            columns.append(np.degrees(make_continuous(decompose(rotations[:, index], "ZXY"))))
    lines += ["MOTION", f"Frames: {len(rows)}", f"Frame Time: {1 / rate:.8f}"]
    table = np.concatenate(columns, axis=1)[rows]
    with open_text(path) as file:
        file.write("\n".join(lines) + "\n")
        np.savetxt(file, table, fmt="%.6f")


def is_end(skeleton: Skeleton, index: int) -> bool:
    """Return whether a node is its parent's end site: the only point there, without children."""
    node = skeleton.nodes[index]
    alone = node.parent >= 0 and skeleton.children(node.parent) == [index]
    return node.bone is None and alone and not skeleton.children(index)


def is_translating(body: BodyModel, bone: int | None) -> bool:
    """Return whether a bone's origin moves relative to its parent's, as a root's does."""
    return bone is not None and (
        body.bones[bone].parent < 0 or any(axis.kind[0] == "t" for axis in body.bones[bone].axes)
    )


def _format_node(skeleton: Skeleton, body: BodyModel, index: int, depth: int) -> list[str]:
    """Return the lines of a node and of all its descendants."""
    node, indent, inner = skeleton.nodes[index], "\t" * depth, "\t" * (depth + 1)
    offset = f"{inner}OFFSET " + " ".join(f"{100 * value:.6f}" for value in node.offset)
    if is_end(skeleton, index):
        return [f"{indent}End Site", f"{indent}{{", offset, f"{indent}}}"]
    channels = f"6 {_SHIFTS} {_TURNS}" if is_translating(body, node.bone) else f"3 {_TURNS}"
    lines = [f"{indent}{'ROOT' if node.parent < 0 else 'JOINT'} {node.name}", f"{indent}{{"]
    lines += [offset, f"{inner}CHANNELS {channels}"]
    children = skeleton.children(index)
    for child in children:
        lines += _format_node(skeleton, body, child, depth + 1)
    if not children:
        lines += [f"{inner}End Site", f"{inner}{{", f"{inner}\tOFFSET 0 {_STUB:g} 0", f"{inner}}}"]
    return [*lines, f"{indent}}}"]


def make_continuous(angles: np.ndarray) -> np.ndarray:
    """Return angles of the same rotations about Z, X' and Y'' with the smallest jumps between
    frames.

    angles: (F, 3), rad.
    """
    other = angles * (1, -1, 1) + np.pi
    steps = np.stack([angles[1:], other[1:]]) - angles[:-1]
    same, changed = np.abs(steps - 2 * np.pi * np.round(steps / (2 * np.pi))).sum(-1)
    taken = np.append(0, np.cumsum(changed < same) % 2)[:, None]
    return np.unwrap(np.where(taken, other, angles), axis=0)
