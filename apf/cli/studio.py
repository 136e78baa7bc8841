"""`apf studio`: a page in the browser to watch, run and correct."""

from __future__ import annotations

from functools import lru_cache, partial

from apf.live.cameras import Captures
from apf.request import StudioRequest
from apf.studio.folders import Roots, find_kind
from apf.studio.page import Page
from cl import UserError, select_device
from psfs.cli.view import serve
from psfs.common.outputs import check_place


def run(request: StudioRequest) -> None:
    check_place(request.output)
    roots = Roots(request.folder)
    make_device = lru_cache(1)(partial(select_device, request.device))
    captures = Captures(request.captures) if request.captures else None
    try:
        page = Page(
            roots, make_device, request.port,
            results=request.output, device=request.device, captures=captures,
        )  # fmt: skip
    except UserError:
        if captures is not None:
            captures.close()
        raise
    try:
        if captures is not None:
            page.open_cameras()
        elif find_kind(request.folder) is not None:
            page.open(request.folder)
        serve(page, request)
    finally:
        page.stop()
