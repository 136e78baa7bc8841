#!/usr/bin/env python3
"""Draw the pictures of docs/filming.md: good and bad footage with the silhouettes that come of it.

    scripts/filming_pictures.py DATA -o docs/filming

DATA holds the sequences of the accuracy tables. A picture shows examples side by side, each with
its silhouette: what is missed of the true mask is red, what is too much is green.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np

from cl import Device, InputError, select_device
from psfs.cli.commandline import add_message_flags, progress_bar, stdout
from psfs.cli.program import run_command
from psfs.common.files import write_picture
from psfs.common.regions import bounding_box
from psfs.diagnostics.silhouette_mosaic import draw_differences
from psfs.diagnostics.silhouette_scores import score_silhouettes
from psfs.output.preview import crop_view
from psfs.sequence import Sequence
from psfs.session import Session

#: Examples (sequence, camera, frame) in each picture, good ones first.
PICTURES = {
    "clothes": [("synth_salsa_4cam_hd", "cam01", 40), ("hard_noplate_6cam", "cam01", 60)],
    "loose": [("synth_walk_4cam", "cam01", 40), ("hard_skirt_4cam", "cam01", 60)],
    "noise": [("synth_run_6cam", "cam01", 40), ("hard_real_5cam", "cam04", 40)],
    "furniture": [("hard_chair_6cam", "cam03", 40), ("hard_chair_6cam", "cam02", 40)],
    "shadow": [("hard_floor_8cam", "cam05", 80), ("hard_floor_8cam", "cam01", 80)],
}
#: Height of a panel, px; share of the person's size around the person; gap between examples, px.
_HEIGHT, _AROUND, _GAP = 210, 0.15, 8


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="filming_pictures.py", description=__doc__.splitlines()[0]
    )
    parser.add_argument("data", type=Path, metavar="DATA", help="folder with the sequences")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="folder")
    parser.add_argument("--device", default="auto")
    add_message_flags(parser)
    parser.set_defaults(run=_run)
    return run_command(parser)


def _run(args: argparse.Namespace) -> None:
    device = select_device(args.device)
    args.output.mkdir(parents=True, exist_ok=True)
    with progress_bar() as bar:
        for name, examples in bar.track(PICTURES.items(), description="drawing"):
            panels = [draw_example(device, args.data / of, *rest) for of, *rest in examples]
            gap = np.full((_HEIGHT, _GAP, 3), 255, np.uint8)
            drawn = np.hstack([part for panel in panels for part in (panel, gap)][:-1])
            write_picture(args.output / f"{name}.jpg", drawn)
    stdout.print(f"wrote {args.output}", soft_wrap=True)


def draw_example(device: Device, folder: Path, camera: str, frame: int) -> np.ndarray:
    """Return (_HEIGHT, w, 3) uint8 BGR: the picture of one camera around the person, and beside it
    the silhouette compared with the true mask. Raises InputError if there is no true mask."""
    sequence = Sequence.open(folder)
    view = sequence.rig.names.index(camera)
    *_, found = score_silhouettes(Session(sequence, device), [frame])
    truth = found.truth[view]
    if truth is None or not truth.any():
        raise InputError(f"{folder}: no true mask of {camera} in frame {frame}")
    around = _crop_square(truth)
    picture = crop_view(found.frame, view, sequence.rig[view])[around]
    drawn = draw_differences(picture, found.masks[view][around], truth[around])
    both = np.hstack([picture, drawn])
    width = round(both.shape[1] * _HEIGHT / both.shape[0])
    return cv2.resize(both, (width, _HEIGHT), interpolation=cv2.INTER_AREA)


def _crop_square(mask: np.ndarray) -> tuple[slice, slice]:
    """Return rows and columns of a square around the mask (H, W), as far as there are pixels."""
    rows, columns = bounding_box(mask)
    half = (0.5 + _AROUND) * max(rows.stop - rows.start, columns.stop - columns.start)
    middle = (rows.start + rows.stop) / 2, (columns.start + columns.stop) / 2
    ends = [
        (max(0, int(m - half)), min(n, int(m + half)))
        for m, n in zip(middle, mask.shape, strict=True)
    ]
    return slice(*ends[0]), slice(*ends[1])


if __name__ == "__main__":
    sys.exit(main())
