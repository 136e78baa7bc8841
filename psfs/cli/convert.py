"""`psfs convert FOLDER -o NATIVE`: conversion of any readable folder to the native layout."""

from __future__ import annotations

import argparse

from psfs.cameras.calibration.writers import write_calibration
from psfs.cli.commandline import remark, stdout
from psfs.cli.sequence_flags import open_sequence
from psfs.common.outputs import output_folder
from psfs.output.convert import write_native
from psfs.sequence import Sequence


def run(args: argparse.Namespace) -> None:
    sequence = open_sequence(args)
    for note in sequence.notes:
        remark("note", "cyan", note)
    if args.to is not None:
        _write_calibration(args, sequence)
        return
    folders = ("videos", "images", "masks", "background")
    expected = ["calibration.toml", "sequence.toml", *(f"{f}/**/*.*" for f in folders)]
    with output_folder(args.output, args.parser.prog, sequence.inputs, expected):
        write_native(sequence, args.output)
    stdout.print(
        f"wrote {args.output}: {len(sequence.rig)} cameras, {len(sequence)} frames",
        soft_wrap=True,
        markup=False,
    )


def _write_calibration(args: argparse.Namespace, sequence: Sequence) -> None:
    """Write the calibration as the program --to has it."""
    names = ("camera_array.toml", "calibration_psfs.json", "Calib.qca.txt", "*tri.yml")
    expected = [*names, "calib/*.yml", "sparse/0/*.txt"]
    with output_folder(args.output, args.parser.prog, sequence.inputs, expected):
        written = write_calibration(args.output, sequence.rig, args.to)
    stdout.print(
        f"wrote {written}: {len(sequence.rig)} cameras for {args.to}", soft_wrap=True, markup=False
    )
