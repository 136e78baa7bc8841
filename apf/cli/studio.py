"""`apf studio`: a page in the browser to watch, run and correct."""

from __future__ import annotations

import argparse
from functools import lru_cache, partial

from apf.live.recording import Captures
from apf.studio.folders import Roots, find_kind
from apf.studio.page import Page
from cl import UserError, select_device
from psfs.cli.serve import check_port, serve
from psfs.common.outputs import check_place


def run(args: argparse.Namespace) -> None:
    check_port(args)
    check_place(args.output)
    roots = Roots(args.folder)
    make_device = lru_cache(1)(partial(select_device, args.device))
    captures = Captures(args.captures) if args.captures else None
    try:
        page = Page(
            roots, make_device, args.port,
            results=args.output, device=args.device, captures=captures,
        )  # fmt: skip
    except UserError:
        if captures is not None:
            captures.close()
        raise
    try:
        if captures is not None:
            page.open_cameras()
        elif find_kind(args.folder) is not None:
            page.open(args.folder)
        serve(page, args)
    finally:
        page.stop()
