"""The flags of `psfs silhouettes`."""

from __future__ import annotations

import argparse

from psfs.cli.commandline import add_device_flag, add_output_flag
from psfs.cli.sequence_flags import add_sequence_flags
from psfs.cli.sequence_flags import check as check
from psfs.cli.settings import add_configs, add_preset_flag
from psfs.presets import PRESETS
from psfs.settings import Settings

REPORT = "silhouettes.json"
#: Frames shown by default, spread over the sequence.
SHOWN = 6


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    what = parser.description
    parser.description = (
        f"{what}. OUT gets frame_NNNNNN.png, a row per camera: picture, likelihood, silhouette; "
        "where FOLDER has truth_masks/CAMERA_NNNNNN.png also what is missed (red) and too much "
        f"(green); and {REPORT}. All frames before those shown are reconstructed, since "
        f"silhouettes learn from them. Shown by default: frames with true masks, else {SHOWN} "
        "spread over the sequence."
    )
    add_sequence_flags(parser)
    add_output_flag(parser, "folder")
    add_device_flag(parser)
    add_configs(parser, Settings, "reconstruction")
    add_preset_flag(parser, PRESETS)
