"""`psfs convert FOLDER -o NATIVE`: any folder that can be read, as a native one."""

from __future__ import annotations

import argparse
from pathlib import Path

from psfs.cli.commandline import add_command, remark, stdout
from psfs.cli.sequence_flags import add_sequence_flags, open_sequence
from psfs.common.outputs import output_folder
from psfs.output.convert import write_native


def register(commands: argparse._SubParsersAction) -> None:
    help = "write any footage that can be read as a native folder"
    parser = add_command(commands, "convert", _run, help=help)
    parser.description = (
        f"{help}: calibration.toml in metres with Z up, sequence.toml, and copies of the pictures "
        "named after their cameras. What the flags state is part of it."
    )
    add_sequence_flags(parser, frames=False)
    parser.add_argument(
        "-o", "--output", required=True, type=Path, metavar="NATIVE", help="new folder"
    )


def _run(args: argparse.Namespace) -> None:
    sequence = open_sequence(args)
    for note in sequence.notes:
        remark("note", "cyan", note)
    folders = ("videos", "images", "masks", "background")
    expected = ["calibration.toml", "sequence.toml", *(f"{f}/**/*.*" for f in folders)]
    with output_folder(args.output, args.parser.prog, sequence.inputs, expected):
        write_native(sequence, args.output)
    stdout.print(
        f"wrote {args.output}: {len(sequence.rig)} cameras, {len(sequence)} frames",
        soft_wrap=True,
        markup=False,
    )
