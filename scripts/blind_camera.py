#!/usr/bin/env python3
"""A copy of a sequence in which one camera's room is painted with the colour of the shirt.

    scripts/blind_camera.py FOLDER -o OUT [--camera cam01]

That room keeps its noise, light and shadows: every pixel that is not the person's differs from
the painted background as it did from the true one. The person is what the untouched sequence's
silhouettes and true masks show. All other files are links to those of FOLDER.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np

from cl import InputError, select_device
from psfs.cli.commandline import add_device_flag, add_message_flags, stdout
from psfs.cli.program import run_command
from psfs.diagnostics.reprojection_iou import volume_region
from psfs.diagnostics.silhouette_scores import true_mask
from psfs.sequence import Sequence
from psfs.session import Session
from psfs.volume import automatic_grid

#: Heights of the shirt's colour, as shares of the person's from the top.
_SHIRT = (0.18, 0.45)


def main() -> int:
    parser = argparse.ArgumentParser(prog="blind_camera.py", description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT")
    parser.add_argument("--camera", default="cam01", metavar="NAME")
    add_device_flag(parser)
    add_message_flags(parser)
    parser.set_defaults(run=_run)
    return run_command(parser)


def _run(args: argparse.Namespace) -> None:
    sequence = Sequence.open(args.folder)
    if args.camera not in sequence.rig.names:
        raise InputError(f"--camera {args.camera}; expected one of {sequence.rig.names}")
    view = sequence.rig.names.index(args.camera)
    camera = sequence.rig[view]
    size = (slice(camera.size[1]), slice(camera.size[0]))
    session = Session(sequence, select_device(args.device))
    grid = automatic_grid(session)
    within = volume_region(sequence.rig, grid)[view][size]
    reconstruct = session.reconstructor(grid)
    room = _read(args.folder / "background" / f"{args.camera}.mp4")
    empty = np.mean(room, 0, dtype=np.float32)
    pictures, people = [], []
    for frame in sequence.frames(slice(None)):
        reconstruct(frame)
        person = (reconstruct.evidence()[view][size] > 0) & within
        truth = true_mask(sequence.folder, camera, frame.index, camera.size[::-1])
        assert frame.images is not None
        pictures.append(frame.images[view][size].copy())
        people.append(person if truth is None else person | truth)
    colour = _shirt_colour(pictures[0], people[0])
    for path in args.folder.rglob("*"):
        link = args.output / path.relative_to(args.folder)
        if path.is_file() and path.name != f"{args.camera}.mp4":
            link.parent.mkdir(parents=True, exist_ok=True)
            link.symlink_to(path.resolve())
    nowhere = [np.zeros(camera.size[::-1], bool)] * len(room)
    for name, shown, persons in (("background", room, nowhere), ("videos", pictures, people)):
        painted = [
            np.where(m[..., None], p, np.clip(p - empty + colour, 0, 255)).astype(np.uint8)
            for p, m in zip(shown, persons, strict=True)
        ]
        _write(args.output / name / f"{args.camera}.avi", painted, sequence.fps)
    stdout.print(
        f"wrote {args.output}: {args.camera} painted with BGR {colour.round().astype(int)}"
    )


def _shirt_colour(picture: np.ndarray, person: np.ndarray) -> np.ndarray:
    rows = np.flatnonzero(person.any(1))
    high, low = (round(rows[0] + share * (rows[-1] - rows[0])) for share in _SHIRT)
    return np.median(picture[high:low][person[high:low]], 0)


def _read(path: Path) -> list[np.ndarray]:
    video, shown = cv2.VideoCapture(str(path)), []
    while True:
        there, picture = video.read()
        if not there:
            break
        shown.append(picture)
    if not shown:
        raise InputError(f"{path}: no video; expected one of the empty room")
    return shown


def _write(path: Path, pictures: list[np.ndarray], fps: float) -> None:
    height, width = pictures[0].shape[:2]
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), fps, (width, height))
    for picture in pictures:
        video.write(picture)
    video.release()
    if not path.stat().st_size:
        raise InputError(f"{path}: OpenCV cannot write FFV1; expected its FFmpeg")


if __name__ == "__main__":
    sys.exit(main())
