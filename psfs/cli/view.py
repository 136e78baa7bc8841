"""`psfs view OUT`: a page in the browser that plays the voxel clouds, or their surfaces."""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np

from cl import InputError, select_device
from psfs.cli.commandline import stdout, warn
from psfs.cli.serve import check_port, serve
from psfs.common.files import check_picture_name, write_picture
from psfs.common.outputs import output_folder
from psfs.mesh.marching_cubes import Mesher
from psfs.mesh.preview import draw_mesh_preview
from psfs.output.preview import draw_preview
from psfs.output.reconstruction_folder import ReconstructionFolder
from psfs.page.frame import ViewPage
from psfs.page.gate import MissingViserError
from psfs.page.opened import Opened, open_voxels
from psfs.page.watch import Watch
from psfs.sequence import Frame, Sequence

#: Opens a run; see `ViewPage`.
OpenRun = Callable[[Callable[[int], object]], Opened]


def run(args: argparse.Namespace) -> None:
    run, frame = open_folder(args)
    if args.png is not None:
        sequence = run.sequence()
        write_view(args, sequence, lambda: draw_run(args, run, sequence.read(frame)))
    else:
        show_page(args, lambda known: open_voxels(args.out, make_mesher(args, run)), frame)


def open_folder(args: argparse.Namespace) -> tuple[ReconstructionFolder, int]:
    """Open the run `args.out`; return it, and the frame that is shown first. Raises InputError."""
    run = ReconstructionFolder.open(args.out)
    run.warn_if_unfinished(warn)
    return run, run.choose_frame(args.frame)


def make_mesher(args: argparse.Namespace, run: ReconstructionFolder) -> Mesher | None:
    """Return what makes the meshes of a run; None without --mesh."""
    return Mesher(select_device(args.device), run, run.sequence()) if args.mesh else None


def write_view(
    args: argparse.Namespace, sequence: Sequence, draw: Callable[[], np.ndarray]
) -> None:
    """Write --png, the picture (h, w, 3) uint8 BGR that `draw` makes from `sequence`."""
    check_picture_name(args.png, (*sequence.inputs[1:], args.out / "clouds"))
    picture = draw()
    with output_folder(args.out, args.parser.prog, addition=True):
        write_picture(args.png, picture)
    stdout.print(f"wrote {args.png}", soft_wrap=True)


def show_page(
    args: argparse.Namespace, open_run: OpenRun, frame: int | None, watch: type[Watch] = Watch
) -> None:
    """Show a run on a page until Ctrl-C, beginning with `frame`; watch: the class that shows it."""
    check_port(args)
    try:
        page = ViewPage(open_run, frame=frame, watch=watch, port=args.port)
    except MissingViserError as error:
        raise InputError(f"{error}; --png FILE writes a picture without it") from None
    try:
        serve(page, args)
    finally:
        page.stop()


def draw_run(args: argparse.Namespace, run: ReconstructionFolder, frame: Frame) -> np.ndarray:
    """Return the picture (h, w, 3) uint8 BGR of a frame's cloud or, with --mesh, its mesh."""
    sequence, cloud, mesher = run.sequence(), run.cloud(frame.index), make_mesher(args, run)
    title = f"{sequence.name}, frame {frame.index}"
    if mesher is None or not len(cloud):
        return draw_preview(cloud, sequence.rig, frame, title)
    return draw_mesh_preview(mesher(frame.index), sequence.rig, frame, title)
