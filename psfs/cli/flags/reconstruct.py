"""The flags of `psfs reconstruct`."""

from __future__ import annotations

import argparse
from pathlib import Path

from cl import InputError
from psfs.cli.commandline import add_device_flag, add_output_flag
from psfs.cli.sequence_flags import (
    add_all_cameras_flag,
    add_sequence_flags,
    voxel_edge,
)
from psfs.cli.sequence_flags import check as check
from psfs.cli.settings import add_configs, add_preset_flag
from psfs.presets import PRESETS
from psfs.settings import Settings
from psfs.voxels.limits import DEBRIS_SHARE

#: Greatest number of voxels along an axis in --grid.
_MOST_ALONG = 10_000


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    what = parser.description
    parser.description = (
        f"{what}. OUT gets clouds/frame_NNNNNN.ply and .npz, summary.json and preview.png. "
        "Without a stated volume it is found from the cameras and the first silhouettes."
    )
    add_sequence_flags(parser)
    add_output_flag(parser, "new folder")
    size = parser.add_mutually_exclusive_group()
    size.add_argument(
        "--grid", type=_shape, metavar="NX,NY,NZ", help="number of voxels along each axis"
    )
    size.add_argument("--voxel-size", type=voxel_edge, metavar="M", help="edge of a voxel, metres")
    parser.add_argument(
        "--debris",
        type=float,
        default=DEBRIS_SHARE,
        metavar="SHARE",
        help="drop connected parts smaller than this share of the largest one "
        f"(default {DEBRIS_SHARE:g}; 0 keeps everything, 1 only the largest)",
    )
    parser.add_argument(
        "--no-colour", action="store_true", help="do not colour the clouds from the pictures"
    )
    parser.add_argument(
        "--normals", action="store_true", help="write the surface's normals into the PLY"
    )
    parser.add_argument(
        "--track",
        type=Path,
        metavar="OUT",
        help="use a track of the same frames (a folder of `apf track`, or its npz) as a prior of "
        "the voxels: limbs that silhouettes miss stay",
    )
    add_all_cameras_flag(parser)
    add_device_flag(parser)
    add_configs(parser, Settings, "reconstruction")
    add_preset_flag(parser, PRESETS)


def _shape(text: str) -> tuple[int, int, int]:
    import numpy as np

    from psfs.voxels.grid import VoxelGrid

    try:
        nx, ny, nz = (int(word) for word in text.split(","))
        VoxelGrid(np.zeros(3), 1.0, (nx, ny, nz))
        if max(nx, ny, nz) > _MOST_ALONG:
            raise InputError(f"at most {_MOST_ALONG} along each axis")
    except ValueError as error:
        detail = f": {error}" if isinstance(error, InputError) else ""
        raise argparse.ArgumentTypeError(
            f"{text!r} is no grid{detail}; expected NX,NY,NZ"
        ) from None
    return nx, ny, nz
