"""Serve a page until Ctrl-C, for all commands that open one."""

from __future__ import annotations

import threading
import webbrowser

from cl import InputError
from psfs.cli.commandline import stdout
from psfs.page.frame import BrowserPage
from psfs.request import PageRequest


def check_port(request: PageRequest) -> None:
    """Raise InputError for a --port that is none."""
    if not 0 <= request.port <= 65535:
        raise InputError(f"--port is {request.port}; expected 0 (any) to 65535")


def serve(page: BrowserPage, request: PageRequest) -> None:
    """Print the address of a page, open it in a browser unless --no-browser is given, and wait for
    Ctrl-C."""
    stdout.print(f"{page.address} (for this machine alone; Ctrl-C ends)", soft_wrap=True)
    if request.browser:
        webbrowser.open(page.address)
    threading.Event().wait()
