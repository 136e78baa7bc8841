"""`psfs view OUT`: a page in the browser that plays the voxel clouds, or their surfaces."""

from __future__ import annotations

import threading
import webbrowser
from collections.abc import Callable

import numpy as np

from cl import InputError, select_device
from psfs.cli.commandline import stdout, warn
from psfs.common.files import check_picture_name, write_picture
from psfs.common.outputs import output_folder
from psfs.mesh.marching_cubes import Mesher
from psfs.mesh.preview import draw_mesh_preview
from psfs.output.preview import draw_preview
from psfs.output.reconstruction_folder import ReconstructionFolder
from psfs.page.clouds import Opened, open_voxels
from psfs.page.server import BrowserPage, import_viser
from psfs.page.watch import ViewPage, Watch
from psfs.request import PageRequest, ViewRequest
from psfs.sequence import Frame, Sequence

#: Opens a run; see `ViewPage`.
OpenRun = Callable[[Callable[[int], object]], Opened]


def run(request: ViewRequest) -> None:
    run, frame = open_folder(request)
    if request.png is not None:
        sequence = run.sequence()
        write_view(request, sequence, lambda: draw_run(request, run, sequence.read(frame)))
    else:
        show_page(request, lambda known: open_voxels(request.out, make_mesher(request, run)), frame)


def open_folder(request: ViewRequest) -> tuple[ReconstructionFolder, int]:
    """Return the run `request.out`, and the frame that is shown first. Raises InputError."""
    run = ReconstructionFolder.open(request.out)
    run.warn_if_unfinished(warn)
    return run, run.choose_frame(request.frame)


def make_mesher(request: ViewRequest, run: ReconstructionFolder) -> Mesher | None:
    """Return what makes the meshes of a run; None without --mesh."""
    return Mesher(select_device(request.device), run, run.sequence()) if request.mesh else None


def write_view(request: ViewRequest, sequence: Sequence, draw: Callable[[], np.ndarray]) -> None:
    """Write --png, the picture (h, w, 3) uint8 BGR that `draw` makes from `sequence`."""
    assert request.png is not None
    check_picture_name(request.png, (*sequence.inputs[1:], request.out / "clouds"))
    picture = draw()
    with output_folder(request.out, request.COMMAND, addition=True):
        write_picture(request.png, picture)
    stdout.print(f"wrote {request.png}")


def show_page(
    request: ViewRequest, open_run: OpenRun, frame: int | None, watch: type[Watch] = Watch
) -> None:
    """Show a run on a page until Ctrl-C, beginning with `frame`; watch: the class that shows it."""
    try:
        import_viser()
    except InputError as error:
        raise InputError(f"{error}; --png FILE writes a picture without it") from None
    page = ViewPage(open_run, frame=frame, watch=watch, port=request.port)
    try:
        serve(page, request)
    finally:
        page.stop()


def draw_run(request: ViewRequest, run: ReconstructionFolder, frame: Frame) -> np.ndarray:
    """Return the picture (h, w, 3) uint8 BGR of a frame's cloud or, with --mesh, its mesh."""
    sequence, cloud, mesher = run.sequence(), run.cloud(frame.index), make_mesher(request, run)
    title = f"{sequence.name}, frame {frame.index}"
    if mesher is None or not len(cloud):
        return draw_preview(cloud, sequence.rig, frame, title)
    return draw_mesh_preview(mesher(frame.index), sequence.rig, frame, title)


def serve(page: BrowserPage, request: PageRequest) -> None:
    """Print the address of a page, open it in a browser unless --no-browser is given, and wait for
    Ctrl-C."""
    stdout.print(f"{page.address} (for this machine alone; Ctrl-C ends)")
    if request.browser:
        webbrowser.open(page.address)
    threading.Event().wait()
