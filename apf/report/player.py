"""The contents of the page's player: joints and voxels of every frame, packed."""

from __future__ import annotations

import base64

import numpy as np

from apf.report.quality import Quality
from apf.report.scene_colours import LOST, colour_edges
from psfs.page.clouds import choose_block_width, merge_voxels
from psfs.page.colours import colour_voxels

#: About the greatest number of blocks of voxels in all frames together, and in one frame: 12 MB and
#: 60 kB of page. More would not be visible at the size of the player.
_MOST_VOXELS, _MOST_OF_A_FRAME = 400_000, 4_000


def player_scene(quality: Quality) -> dict[str, object]:
    """Return the skeleton in all frames and, if there are any, the voxels in the judged ones.

    Arrays are base64 of little-endian numbers: joints float32 (F, J, 3) m; voxel cells uint8 or
    uint16 (N, 3) of a grid with `origin` and `size` m, frame after frame by `counts`, and RGB uint8
    (N, 3).
    """
    track = quality.track
    joints = track.joints.reshape(-1, 3)
    low, high = joints.min(axis=0), joints.max(axis=0)
    scene: dict[str, object] = {
        "joint_names": list(track.joint_names),
        "edges": track.edges.tolist(),
        "edge_colours": [f"rgb({r}, {g}, {b})" for r, g, b in colour_edges(track).tolist()],
        "lost_colour": "rgb({}, {}, {})".format(*LOST),
        "joints": encode(track.joints, "<f4"),
        "low": (low - 0.2).round(3).tolist(),
        "high": (high + 0.2).round(3).tolist(),
        "voxels": None,
    }
    if quality.agreement is not None:
        scene["voxels"] = _pack_voxels(quality)
    return scene


def _pack_voxels(quality: Quality) -> dict[str, object]:
    """Pack the voxels of all judged frames, merged into blocks of one size if they are many."""
    assert quality.agreement is not None
    clouds = quality.agreement.clouds
    most = min(_MOST_OF_A_FRAME, _MOST_VOXELS // max(1, len(clouds)))
    width = choose_block_width(max(len(cloud) for cloud in clouds), most)
    rng = np.random.default_rng(0)
    cells, colours = [], []
    for cloud in clouds:
        blocks, means = merge_voxels(cloud, colour_voxels(cloud), width)
        picked = rng.permutation(len(blocks))[:most]  # all of a surface
        cells.append(blocks[picked])
        colours.append(means[picked])
    grid = clouds[0].grid
    size = width * grid.voxel_size
    kind = "u1" if max(grid.shape) <= 256 * width else "<u2"
    return {
        "counts": [len(cell) for cell in cells],
        "bytes": 1 if kind == "u1" else 2,
        "cells": encode(np.concatenate(cells), kind),
        "colours": encode(np.concatenate(colours), "u1"),
        "origin": (grid.origin + size / 2).round(5).tolist(),
        "size": size,
    }


def encode(values: np.ndarray, kind: str) -> str:
    """Return numbers as base64 of the little-endian type `kind`."""
    return base64.b64encode(np.ascontiguousarray(values).astype(kind).tobytes()).decode()
