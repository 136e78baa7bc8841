"""`apf track`: estimate a skeleton per frame."""

from __future__ import annotations

from contextlib import ExitStack

from apf.request import TrackRequest
from apf.tracking.progress import ProgressLine, make_stage_bar
from cl import InputError
from psfs.cli.commandline import progress_bar, remark, stderr, stdout, warn


class TakeLine(ProgressLine):
    """The line of a take in the bar of a command, which prints what there is to tell."""

    def warn(self, text: str) -> None:
        warn(text)

    def note(self, text: str) -> None:
        remark("note", "cyan", text)

    def tell(self, text: str) -> None:
        stderr.print(text)


def run(request: TrackRequest) -> None:
    if request.triangulate:
        from apf.cli.triangulate import run_triangulate

        run_triangulate(request, TakeLine(progress_bar()))
        return
    if len(request.folders) > 1:
        from apf.cli.batch import run as run_batch
        from apf.takes.track import check_request

        check_request(request)
        request.refuse(["corrections"], "applies only to one take; expected none with several")
        if request.init is not None:
            raise InputError("--init is the first pose of one take; expected none with several")
        run_batch(request.batch())
        return
    with ExitStack() as stack:
        bar = stack.enter_context(make_stage_bar(stderr.console, stdout.quiet))
        line = TakeLine(bar)
        # The bar is shown while these are loaded, which takes a second.
        from apf.backend import check_renderer
        from apf.cli.take_report import track_one
        from apf.takes.track import check_request
        from cl import select_device

        check_request(request)
        device = select_device(request.device)
        check_renderer(device, request.method)
        track_one(request, device, line, stack.close)
