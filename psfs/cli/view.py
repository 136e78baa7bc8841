"""`psfs view OUT`: viewer of the voxel clouds, or of their surfaces, over time."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import trimesh

from cl import select_device
from psfs.cameras.camera import CameraRig
from psfs.cli.commandline import stdout, warn
from psfs.common.files import check_picture_name, write_picture
from psfs.common.outputs import output_folder
from psfs.mesh.drawing import (
    Layer,
    Shape,
    draw_floor,
    draw_frusta,
    make_static_layer,
    make_voxel_layer,
)
from psfs.mesh.marching_cubes import Mesher
from psfs.mesh.playback import Playback
from psfs.mesh.player import Player
from psfs.mesh.preview import draw_mesh_preview
from psfs.mesh.viewer import has_display, show_window
from psfs.output.preview import draw_preview
from psfs.output.reconstruction_folder import ReconstructionFolder
from psfs.sequence import Frame
from psfs.voxels.grid import VoxelCloud

#: Opacity of voxels with something drawn inside them.
_BEHIND = 0.7


def run(args: argparse.Namespace) -> None:
    view_run(args, OnTop())


@dataclass(frozen=True)
class OnTop:
    """Additions to the view of a run's clouds."""

    layers: Sequence[Layer] = ()
    note: Callable[[int], str] = lambda _frame: ""
    """Caption of a frame, by its number."""
    picture: Callable[[Frame, CameraRig], np.ndarray] | None = None
    """Picture (h, w, 3) uint8 BGR that is written without a window; by default the clouds."""


def view_run(args: argparse.Namespace, on_top: OnTop) -> None:
    """Show the run `args.out` in a window; without a display, or with --png, write a picture."""
    run = ReconstructionFolder.open(args.out)
    run.warn_if_unfinished(warn)
    frame = run.choose_frame(args.frame)
    sequence = run.sequence()
    if args.png is not None:
        check_picture_name(args.png, (*sequence.inputs[1:], args.out / "clouds"))
    mesher = Mesher(select_device(args.device), run, sequence) if args.mesh else None

    def shape(index: int) -> tuple[VoxelCloud, trimesh.Trimesh | None]:
        cloud = run.cloud(index)
        return cloud, mesher(index) if mesher and len(cloud) else None

    if args.png is None and has_display():
        show_window(sequence.name, sequence.rig, run.grid, _player(args, run, shape, on_top))
        return
    path = args.png or args.out / f"view_{frame:06d}.png"
    picture = on_top.picture or partial(_picture, shape, sequence.name)
    drawn = picture(sequence.read(frame), sequence.rig)
    with output_folder(args.out, args.parser.prog, addition=True):
        write_picture(path, drawn)
    stdout.print(f"wrote {path}", soft_wrap=True)


def _player(
    args: argparse.Namespace, run: ReconstructionFolder, shape: Shape, on_top: OnTop
) -> Player:
    sequence = run.sequence()
    name, opacity = "meshes" if args.mesh else "voxels", _BEHIND if on_top.layers else 1.0
    layers = (
        make_voxel_layer(shape, run.grid, name, opacity),
        *on_top.layers,
        make_static_layer("cameras", draw_frusta(sequence.rig)),
        make_static_layer("floor", draw_floor(run.grid)),
    )
    playback = Playback(run.indices, sequence.fps, run.choose_frame(args.frame))
    return Player(playback, layers, lambda n: f"{_size(run, n)}   {on_top.note(n)}".strip())


def _picture(shape: Shape, name: str, frame: Frame, rig: CameraRig) -> np.ndarray:
    cloud, mesh = shape(frame.index)
    title = f"{name}, frame {frame.index}"
    if mesh is None:
        return draw_preview(cloud, rig, frame, title)
    return draw_mesh_preview(mesh, rig, frame, title)


def _size(run: ReconstructionFolder, index: int) -> str:
    """Return the size of a frame's cloud, from the run's summary."""
    fact = next(fact for fact in run.summary["frames"] if fact["index"] == index)
    return f"{fact['surface_voxels']:,} voxels, {1e3 * fact['volume_m3']:.3g} l"
