"""The flags of `psfs convert`."""

from __future__ import annotations

import argparse

from psfs.cli.commandline import add_output_flag
from psfs.cli.sequence_flags import add_sequence_flags
from psfs.cli.sequence_flags import check as check

#: The programs whose calibration is written: the names of `psfs.cameras.calibration.writers`.
FORMATS = ("caliscope", "colmap", "easymocap", "opencv", "panoptic", "qualisys")


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    what = parser.description
    parser.description = (
        f"{what}: calibration.toml in metres with Z up, sequence.toml, and copies of the pictures "
        "named after their cameras. What the flags state is part of it. With --to, the calibration "
        "alone, for another program."
    )
    add_sequence_flags(parser, frames=False)
    add_output_flag(parser, "new folder", metavar="NATIVE")
    parser.add_argument(
        "--to", choices=FORMATS, metavar="FORMAT",
        help=f"write the calibration only, as this program has it: {', '.join(FORMATS)}",
    )  # fmt: skip
