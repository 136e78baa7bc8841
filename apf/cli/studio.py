"""`apf studio`: a page in the browser to watch, run and correct."""

from __future__ import annotations

import argparse
import threading
import webbrowser
from functools import lru_cache, partial

from apf.studio.folders import Roots, find_kind
from apf.studio.page import Page
from cl import InputError, select_device
from psfs.cli.commandline import stdout
from psfs.common.outputs import check_place


def run(args: argparse.Namespace) -> None:
    if not 0 <= args.port <= 65535:
        raise InputError(f"--port is {args.port}; expected 0 (any) to 65535")
    check_place(args.output)
    roots = Roots(args.folder)
    make_device = lru_cache(1)(partial(select_device, args.device))
    page = Page(roots, make_device, args.port, results=args.output, device=args.device)
    try:
        if find_kind(args.folder) is not None:
            page.open(args.folder)
        stdout.print(f"{page.address} (for this machine alone; Ctrl-C ends)", soft_wrap=True)
        if not args.no_browser:
            webbrowser.open(page.address)
        threading.Event().wait()
    finally:
        page.stop()
