"""Middlebury's multi-view sets: `*_par.txt` beside one image per view, a single frame."""

from __future__ import annotations

from pathlib import Path

from cl import InputError
from psfs.common.files import read_text
from psfs.footage.layouts.common import Footage, Layout, assign_pictures, choose_cameras, read_rig
from psfs.footage.media import IMAGE_SUFFIXES
from psfs.footage.settings import SequenceSettings


def _matches(folder: Path, settings: SequenceSettings) -> bool:
    return len(list(folder.glob("*_par.txt"))) == 1


def _read(folder: Path, settings: SequenceSettings) -> Footage:
    calibration = next(folder.glob("*_par.txt"))
    if settings.calibration is not None:
        calibration = folder / settings.calibration
    found = {
        path.stem: [path] for path in sorted(folder.iterdir()) if path.suffix in IMAGE_SUFFIXES
    }
    rig = read_rig(calibration, settings, found, folder)
    good = folder / calibration.name.replace("_par.txt", "_good_silhouette_images.txt")
    notes = []
    if settings.cameras is None and good.is_file() and good != calibration:
        names = {
            Path(line.strip()).stem for line in read_text(good, "names of pictures").splitlines()
        }
        kept = tuple(name for name in rig.names if name in names)
        if not kept:
            raise InputError(f"{good}: names no view of {calibration.name}")
        if len(kept) < len(rig):
            notes.append(f"{good.name}: {len(kept)} of {len(rig)} views are used")
        settings = settings.replace(cameras=kept)
    images, remarks = assign_pictures(rig, found, folder, settings, extras=True)
    return Footage(choose_cameras(rig, settings), rig.unit, images=images, notes=notes + remarks)


#: The objects stand along y. The silhouettes follow the recipe in the authors' README: threshold,
#: dilate, erode.
MIDDLEBURY = Layout(
    "middlebury",
    _matches,
    _read,
    SequenceSettings(
        up="y",
        background="threshold",
        threshold=0.19,
        dilate=10,
        erode=7,
        fps=1.0,
        subject="object",
    ),
)
