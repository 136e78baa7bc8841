"""`psfs view OUT`: look at the voxel clouds, or at their surfaces, over time."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import trimesh

from cl import select_device
from psfs.cli.commandline import add_command, add_device_flag, stdout
from psfs.common.files import write_picture
from psfs.mesh.drawing import Layer, floor, frusta, steady_layer, voxel_layer
from psfs.mesh.marching_cubes import Mesher
from psfs.mesh.playback import Playback
from psfs.mesh.player import KEYS, Player
from psfs.mesh.preview import mesh_preview
from psfs.mesh.viewer import has_display, show
from psfs.output.preview import preview
from psfs.output.runs import Run
from psfs.sequence import Sequence as Footage
from psfs.voxels.grid import VoxelCloud


def register(commands: argparse._SubParsersAction) -> None:
    help = "play a run in a window, or write a picture where there is no display"
    parser = add_command(commands, "view", _run, help=help)
    add_view_flags(parser, help)


def add_view_flags(parser: argparse.ArgumentParser, help: str) -> None:
    """Add what `view_run` wants."""
    keys = ", ".join(f"{key} {what}" for key, what in KEYS.items())
    parser.description = f"{help}. Keys of the window: {keys}, 1 to 9 show and hide."
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
    view_run(args)


def view_run(
    args: argparse.Namespace,
    layers: Sequence[Layer] = (),
    note: Callable[[int], str] = lambda _frame: "",
) -> None:
    """Show the run `args.out` in a window, `layers` on top and `note` of each frame in its
    caption; without a display, or with --png, write a picture of the clouds alone."""
    run = Run.open(args.out)
    frame = run.chosen(args.frame)
    sequence = run.sequence()
    mesher = Mesher(select_device(args.device), run, sequence) if args.mesh else None

    def shape(index: int) -> tuple[VoxelCloud, trimesh.Trimesh | None]:
        cloud = run.cloud(index)
        return cloud, mesher(index) if mesher and len(cloud) else None

    if args.png is None and has_display():
        voxels = voxel_layer(shape, run.grid, "meshes" if args.mesh else "voxels")
        player = Player(
            Playback(run.indices, sequence.fps, frame),
            (voxels, *layers, *_surroundings(run, sequence)),
            lambda index: f"{_size(run, index)}   {note(index)}".strip(),
        )
        show(sequence.name, sequence.rig, run.grid, player)
        return
    path = args.png or args.out / f"view_{frame:06d}.png"
    cloud, mesh = shape(frame)
    scene = (sequence.rig, sequence.read(frame), f"{sequence.name}, frame {frame}")
    write_picture(path, preview(cloud, *scene) if mesh is None else mesh_preview(mesh, *scene))
    stdout.print(f"wrote {path}", soft_wrap=True)


def _surroundings(run: Run, sequence: Footage) -> tuple[Layer, Layer]:
    return (
        steady_layer("cameras", frusta(sequence.rig)),
        steady_layer("floor", floor(run.grid)),
    )


def _size(run: Run, index: int) -> str:
    """How large the cloud of a frame is, after the run's summary."""
    fact = next(fact for fact in run.summary["frames"] if fact["index"] == index)
    return f"{fact['surface_voxels']:,} voxels, {1e3 * fact['volume_m3']:.3g} l"
