"""Folders of published recordings: PARSEC's bodytrack, Utrecht's course, Middlebury's sets."""

from __future__ import annotations

from pathlib import Path

from cl import InputError
from psfs.cameras.calibration import read_calibration
from psfs.cameras.calibration.filestorage import read_filestorage
from psfs.cameras.names import name_tokens, natural_key
from psfs.common.files import read_text
from psfs.footage.layouts.common import (
    Footage,
    Found,
    Layout,
    assemble,
    make_size_lookup,
    read_rig,
)
from psfs.footage.media import IMAGE_SUFFIXES, list_images
from psfs.footage.settings import SequenceSettings

#: The pelvis moves about 14 mm per frame, which suits a walk at 60 Hz; no file states the rate.
_BODYTRACK_FPS = 60.0
#: Of Utrecht's calibrations: checkerboard.xml says squares of 115 mm, but the boards in the
#: pictures fit about 151 units, so that one unit is 115 mm / 151.
_UTRECHT_UNIT = "0.76mm"


def _list_bodytrack(folder: Path, prefix: str) -> Found:
    """List the images by camera name: CAM1 and FG1 belong to Camera1.cal."""
    folders = [path for path in folder.glob(f"{prefix}[0-9]*") if path.is_dir()]
    folders.sort(key=lambda path: natural_key(path.name))
    images = {f"Camera{name_tokens(path.name)[-1]}": list_images(path) for path in folders}
    empty = [name for name, paths in images.items() if not paths]
    if empty:
        raise InputError(f"{folder}: no images for {', '.join(empty)} in {prefix}*")
    return images


def _read_bodytrack(folder: Path, settings: SequenceSettings) -> Footage:
    images, masks = _list_bodytrack(folder, "CAM"), _list_bodytrack(folder, "FG")
    rig = read_rig(folder / (settings.calibration or "CALIB"), settings, images, folder / "CAM*")
    guess = f"{_BODYTRACK_FPS:g} frames per second fit the walk; no file states them"
    return assemble(
        rig,
        settings,
        {"images": (images, folder / "CAM*"), "masks": (masks, folder / "FG*")},
        notes=[guess] if settings.fps == _BODYTRACK_FPS else [],
    )


def _list_utrecht(folder: Path, pattern: str) -> Found:
    paths = sorted(folder.glob(f"cam*/{pattern}"), key=lambda path: natural_key(str(path)))
    return {path.parent.name: [path] for path in paths}


def _read_utrecht(folder: Path, settings: SequenceSettings) -> Footage:
    videos, where = _list_utrecht(folder, "video.avi"), folder / "cam*" / "video.avi"
    sizes = make_size_lookup(videos, where, settings)
    if settings.calibration is None:
        files = _list_utrecht(folder, "config.xml")
        paths = [path for (path,) in files.values()]
        rig = read_filestorage(paths, settings.unit, sizes, list(files))
    else:
        rig = read_calibration(folder / settings.calibration, settings.unit, sizes)
    note = f"the unit {_UTRECHT_UNIT} comes from a board of 115 mm that measures 151: uncertain"
    empty = _list_utrecht(folder, "background.avi")
    return assemble(
        rig,
        settings,
        {"images": (videos, where), "background": (empty, folder / "cam*" / "background.avi")},
        notes=[note] if settings.unit == _UTRECHT_UNIT else [],
    )


def _read_middlebury(folder: Path, settings: SequenceSettings) -> Footage:
    calibration = next(folder.glob("*_par.txt"))
    if settings.calibration is not None:
        calibration = folder / settings.calibration
    images = {
        path.stem: [path] for path in sorted(folder.iterdir()) if path.suffix in IMAGE_SUFFIXES
    }
    rig = read_rig(calibration, settings, images, folder)
    good = folder / calibration.name.replace("_par.txt", "_good_silhouette_images.txt")
    notes = []
    if settings.cameras is None and good.is_file() and good != calibration:
        lines = read_text(good, "names of pictures").splitlines()
        names = {Path(line.strip()).stem for line in lines}
        cameras = tuple(name for name in rig.names if name in names)
        if not cameras:
            raise InputError(f"{good}: names no view of {calibration.name}")
        if len(cameras) < len(rig):
            notes.append(f"{good.name}: {len(cameras)} of {len(rig)} views are used")
        settings = settings.replace(cameras=cameras)
    return assemble(rig, settings, {"images": (images, folder)}, extras=True, notes=notes)


#: CALIB/Camera*.cal, CAM*/image*.bmp, FG*/image*.bmp.
BODYTRACK = Layout(
    "bodytrack",
    lambda folder, _: (folder / "CALIB").is_dir() and any(folder.glob("CAM*/")),
    _read_bodytrack,
    SequenceSettings(fps=_BODYTRACK_FPS),
)
#: camN/config.xml, camN/video.avi, camN/background.avi. Z points into the floor.
UTRECHT = Layout(
    "utrecht",
    lambda folder, _: any(folder.glob("cam*/config.xml")),
    _read_utrecht,
    SequenceSettings(unit=_UTRECHT_UNIT, up="-z"),
)
#: `*_par.txt` beside one image per view, a single frame. The objects stand along y. The silhouettes
#: follow the recipe in the authors' README: threshold, dilate, erode.
MIDDLEBURY = Layout(
    "middlebury",
    lambda folder, _: len(list(folder.glob("*_par.txt"))) == 1,
    _read_middlebury,
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
