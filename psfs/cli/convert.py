"""`psfs convert FOLDER -o NATIVE`: conversion of any readable folder to the native layout."""

from __future__ import annotations

import shutil
from collections.abc import Sequence as Items
from pathlib import Path

import numpy as np

from psfs.cameras.calibration.toml_tables import write_toml_tables
from psfs.cameras.calibration.writers import write_calibration
from psfs.cli.commandline import remark, stdout
from psfs.common.files import write_atomically, write_toml
from psfs.common.outputs import output_folder
from psfs.footage.media import Media
from psfs.opening import open_sequence
from psfs.request import ConvertRequest
from psfs.sequence import Sequence


def run(request: ConvertRequest) -> None:
    sequence = open_sequence(request)
    for note in sequence.notes:
        remark("note", "cyan", note)
    if request.to is not None:
        names = ("camera_array.toml", "calibration_psfs.json", "Calib.qca.txt", "*tri.yml")
        expected = [*names, "calib/*.yml", "sparse/0/*.txt"]
        with output_folder(request.output, request.COMMAND, sequence.inputs, expected):
            written = write_calibration(request.output, sequence.rig, request.to)
        stdout.print(f"wrote {written}: {len(sequence.rig)} cameras for {request.to}")
        return
    folders = ("videos", "images", "masks", "background")
    expected = ["calibration.toml", "sequence.toml", *(f"{f}/**/*.*" for f in folders)]
    with output_folder(request.output, request.COMMAND, sequence.inputs, expected):
        write_native(sequence, request.output)
    stdout.print(f"wrote {request.output}: {len(sequence.rig)} cameras, {len(sequence)} frames")


#: Settings that are copied; the calibration's unit and axes become metres and Z up.
_COPIED_SETTINGS = ("fps", "background", "key", "threshold", "dilate", "erode", "sync", "subject")


def write_native(sequence: Sequence, folder: Path) -> None:
    """Write `calibration.toml`, `sequence.toml` and copies of the pictures, named after their
    cameras.

    The calibration is in metres, Z up, of the cameras in use. Raises InputError if `folder` cannot
    be written.
    """
    write_toml_tables(folder / "calibration.toml", sequence.rig)
    footage = sequence.footage
    pictures = "videos" if footage.images and footage.images[0].is_video else "images"
    kinds = {pictures: footage.images, "masks": footage.masks, "background": footage.background}
    for kind, of_kind in kinds.items():
        if of_kind:
            _copy(of_kind, sequence.rig.names, folder / kind)
    values = {key: getattr(sequence.settings, key) for key in _COPIED_SETTINGS}
    media = footage.images or footage.masks or ()
    if values["fps"] is None and not any(item.fps for item in media):
        values["fps"] = sequence.fps
    if sequence.volume is not None:
        values["volume"] = np.array(sequence.volume).tolist()
    stated = {key: value for key, value in values.items() if value is not None}
    write_toml(folder / "sequence.toml", stated)


def _copy(media: Items[Media], names: Items[str], folder: Path) -> None:
    """Copy a video or picture as NAME.suffix, several pictures into NAME/."""
    for name, item in zip(names, media, strict=True):
        several = len(item.paths) > 1 or folder.name in ("images", "masks")
        for path in item.paths:
            one = several and not item.is_video
            target = folder / name / path.name if one else folder / f"{name}{path.suffix}"
            with write_atomically(target) as temporary:
                shutil.copyfile(path, temporary)
