"""The flags of `apf batch`."""

from __future__ import annotations

import argparse

from apf.cli.flags.track import OUTPUT_HELP, add_track_flags
from apf.cluster.config import WorkerConfig
from apf.tracking.exports import EXPORTS
from psfs.cli.commandline import add_output_flag


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_output_flag(parser, OUTPUT_HELP)
    group = parser.add_argument_group("workers", "a process each, which does one take at a time")
    group = group.add_mutually_exclusive_group()
    config = WorkerConfig()
    group.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help=f"on this machine (default: for each GPU {config.per_gpu}, or as many as there are "
        f"{config.beside_gpu:g} cores each; without GPU one for each core)",
    )
    group.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="those of a running Dask cluster: tcp://HOST:PORT, or its scheduler file",
    )
    parser.add_argument(
        "--part-frames",
        type=int,
        metavar="N",
        help="cut longer takes into overlapping parts of about so many frames, which are tracked "
        "at the same time and joined where they agree best (default: not cut)",
    )
    parser.add_argument(
        "--to",
        nargs="*",
        choices=tuple(EXPORTS),
        default=tuple(EXPORTS),
        metavar="FORMAT",
        help=f"export each take as `apf export` does: {', '.join(EXPORTS)} (default: all; --to "
        "alone: none)",
    )
    add_track_flags(parser)
