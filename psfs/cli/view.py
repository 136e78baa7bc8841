"""`psfs view OUT`: look at the voxel clouds, or at their surfaces."""

from __future__ import annotations

import argparse
from pathlib import Path

import trimesh

from cl import select_device
from psfs.cli.commandline import add_command, add_device_flag, stderr, stdout
from psfs.common.files import write_picture
from psfs.mesh.marching_cubes import Mesher
from psfs.mesh.preview import mesh_preview
from psfs.mesh.viewer import KEYS, has_display, show
from psfs.output.preview import preview
from psfs.output.runs import Run
from psfs.voxels.grid import VoxelCloud


def register(commands: argparse._SubParsersAction) -> None:
    help = "show the voxel clouds in a window, or write a picture where there is no display"
    parser = add_command(commands, "view", _run, help=help)
    parser.description = f"{help}. In the window {KEYS}."
    parser.add_argument("out", metavar="OUT", type=Path, help="output folder of psfs reconstruct")
    parser.add_argument(
        "--frame",
        type=int,
        metavar="N",
        help="frame to show (default: the first that is not empty)",
    )
    parser.add_argument("--mesh", action="store_true", help="show the surfaces of psfs mesh")
    parser.add_argument("--png", type=Path, metavar="FILE", help="write a picture, open no window")
    add_device_flag(parser)


def _run(args: argparse.Namespace) -> None:
    run = Run.open(args.out)
    frame = run.chosen(args.frame)
    sequence = run.sequence()
    mesher = Mesher(select_device(args.device), run, sequence) if args.mesh else None

    def shape(index: int) -> VoxelCloud | trimesh.Trimesh:
        cloud = run.cloud(index)
        return mesher(index) if mesher and len(cloud) else cloud

    title = f"{sequence.name}, frame {frame}"
    if args.png is None and has_display():

        def told(index: int) -> VoxelCloud | trimesh.Trimesh:
            stderr.print(f"frame {index}", end="\r")
            return shape(index)

        show(sequence.name, sequence.rig, run.indices, frame, told)
        return
    path = args.png or args.out / f"view_{frame:06d}.png"
    pictured, scene = shape(frame), (sequence.rig, sequence.read(frame), title)
    if isinstance(pictured, VoxelCloud):
        write_picture(path, preview(pictured, *scene))
    else:
        write_picture(path, mesh_preview(pictured, *scene))
    stdout.print(f"wrote {path}", soft_wrap=True)
