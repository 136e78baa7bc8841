"""`psfs convert FOLDER -o NATIVE`: conversion of any readable folder to the native layout."""

from __future__ import annotations

import argparse

from psfs.cli.commandline import remark, stdout
from psfs.cli.sequence_flags import open_sequence
from psfs.common.outputs import output_folder
from psfs.output.convert import write_native


def run(args: argparse.Namespace) -> None:
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
