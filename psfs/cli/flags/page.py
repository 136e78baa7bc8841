"""The flags of all commands that open a page."""

from __future__ import annotations

import argparse


def add_page_flags(parser: argparse.ArgumentParser) -> None:
    """Add --port and --no-browser."""
    parser.add_argument(
        "--port", type=int, default=8090, metavar="N", help="port on 127.0.0.1 (default: 8090)"
    )
    parser.add_argument(
        "--no-browser", action="store_true", help="print the address, and open no browser"
    )
