"""The flags of `apf smooth`."""

from __future__ import annotations

import argparse

from apf.cli.flags.shared import add_smoothing_flags, add_track_path
from psfs.cli.commandline import add_output_flag


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_track_path(parser, "TRACK")
    add_output_flag(parser)
    add_smoothing_flags(parser, "cutoff", "lag")
