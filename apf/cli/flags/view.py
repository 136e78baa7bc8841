"""The flags of `apf view`."""

from __future__ import annotations

import argparse

from apf.cli.flags.shared import add_body_flag, add_track_path
from psfs.cli.flags.view import add_view_flags


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_view_flags(parser)
    add_track_path(parser, "TRACK")
    add_body_flag(parser)
