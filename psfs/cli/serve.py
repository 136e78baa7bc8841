"""Serve a page until Ctrl-C, for all commands that open one."""

from __future__ import annotations

import argparse
import threading
import webbrowser

from cl import InputError
from psfs.cli.commandline import stdout
from psfs.page.frame import BrowserPage


def check_port(args: argparse.Namespace) -> None:
    """Raise InputError for a --port that is none."""
    if not 0 <= args.port <= 65535:
        raise InputError(f"--port is {args.port}; expected 0 (any) to 65535")


def serve(page: BrowserPage, args: argparse.Namespace) -> None:
    """Print the address of a page, open it in a browser unless --no-browser is given, and wait for
    Ctrl-C."""
    stdout.print(f"{page.address} (for this machine alone; Ctrl-C ends)", soft_wrap=True)
    if not args.no_browser:
        webbrowser.open(page.address)
    threading.Event().wait()
