"""`psfs convert FOLDER -o NATIVE`: conversion of any readable folder to the native layout."""

from __future__ import annotations

from psfs.cameras.calibration.writers import write_calibration
from psfs.cli.commandline import remark, stdout
from psfs.common.outputs import output_folder
from psfs.opening import open_sequence
from psfs.output.convert import write_native
from psfs.request import ConvertRequest
from psfs.sequence import Sequence


def run(request: ConvertRequest) -> None:
    sequence = open_sequence(request)
    for note in sequence.notes:
        remark("note", "cyan", note)
    if request.to is not None:
        _write_calibration(request, request.to, sequence)
        return
    folders = ("videos", "images", "masks", "background")
    expected = ["calibration.toml", "sequence.toml", *(f"{f}/**/*.*" for f in folders)]
    with output_folder(request.output, request.COMMAND, sequence.inputs, expected):
        write_native(sequence, request.output)
    stdout.print(f"wrote {request.output}: {len(sequence.rig)} cameras, {len(sequence)} frames")


def _write_calibration(request: ConvertRequest, program: str, sequence: Sequence) -> None:
    """Write the calibration as the program --to has it."""
    names = ("camera_array.toml", "calibration_psfs.json", "Calib.qca.txt", "*tri.yml")
    expected = [*names, "calib/*.yml", "sparse/0/*.txt"]
    with output_folder(request.output, request.COMMAND, sequence.inputs, expected):
        written = write_calibration(request.output, sequence.rig, program)
    stdout.print(f"wrote {written}: {len(sequence.rig)} cameras for {program}")
