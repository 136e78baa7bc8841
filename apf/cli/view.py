"""`apf view OUT`: a page in the browser that plays a track, or a track in stored voxels."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from functools import lru_cache, partial

import numpy as np

from apf.request import ViewRequest
from apf.studio.folders import find_kind
from apf.studio.opened import OpenedTracks, open_track, read_figures
from apf.studio.watch import TrackWatch
from cl import InputError, select_device
from psfs.cli.view import make_mesher, open_folder, show_page, write_view
from psfs.cli.view import run as run_voxels
from psfs.page.clouds import open_voxels


def run(request: ViewRequest) -> None:
    if request.track is not None:
        figures = read_figures(request.track)
        run, frame = open_folder(request)
        mesher = make_mesher(request, run) if request.png is None else None
        voxels = partial(open_voxels, request.out, mesher)
        _view(request, lambda known: OpenedTracks(**vars(voxels()), figures=figures), frame)
    elif find_kind(request.out) == "track" or next(request.out.glob("**/seed*/track.npz"), None):
        if request.mesh:
            what = f"{request.out} is a track, without clouds"
            raise InputError(f"--mesh: {what}; expected a run of psfs reconstruct")
        make_device = lru_cache(1)(partial(select_device, request.device))
        _view(request, partial(open_track, request.out, make_device), request.frame)
    else:
        run_voxels(request)


def _view(
    request: ViewRequest,
    open_run: Callable[[Callable[[int], object]], OpenedTracks],
    frame: int | None,
) -> None:
    """Show a run on a page or, with --png, write a frame's pictures with the body."""
    if request.png is None:
        show_page(request, open_run, frame, TrackWatch)
        return
    with closing(open_run(lambda frame: None)) as opened:
        sequence, shown = opened.sequence, int(opened.frames[0]) if frame is None else frame
        if sequence is None:
            raise InputError(f"{request.out}: {'; '.join(opened.remarks)}; expected its footage")
        if not any(shown in figure.rows for figure in opened.figures.values()):
            raise InputError(f"{request.track or request.out}: frame {shown} was not tracked")

        def draw() -> np.ndarray:
            return opened.draw(sequence.read(shown), None)

        write_view(request, sequence, draw)
