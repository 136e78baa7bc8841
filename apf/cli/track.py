"""`apf track`: estimate a skeleton per frame."""

from __future__ import annotations

from contextlib import ExitStack

from apf.backend import check_renderer
from apf.cli.take_report import TakeLine, track_one
from apf.request import TrackRequest
from apf.takes.job import take_names
from apf.takes.track import check_request
from apf.tracking.progress import make_stage_bar, show_bar
from cl import InputError, select_device
from psfs.cli.commandline import is_quiet, stderr


def run(request: TrackRequest) -> None:
    if request.triangulate:
        from apf.cli.triangulate import run_triangulate  # takes a while to load

        run_triangulate(request, take_names(request.folders))
        return
    check_request(request)
    if len(request.folders) > 1:
        request.refuse(["corrections"], "applies only to one take; expected none with several")
        if request.init is not None:
            raise InputError("--init is the first pose of one take; expected none with several")
        from apf.cli.batch import run as run_batch  # takes a while to load

        run_batch(request.batch())
        return
    bar = make_stage_bar(stderr.console, is_quiet())
    line = TakeLine(bar)
    with ExitStack() as stack:
        stack.enter_context(show_bar(bar))
        device = select_device(request.device)
        check_renderer(device, request.method)
        track_one(request, device, line, stack.close)
