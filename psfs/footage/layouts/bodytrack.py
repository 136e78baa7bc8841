"""PARSEC's bodytrack folder: CALIB/Camera*.cal, CAM*/image*.bmp, FG*/image*.bmp."""

from __future__ import annotations

from pathlib import Path

from cl import InputError
from psfs.cameras.names import name_tokens, natural_key
from psfs.footage.layouts.common import (
    Footage,
    Found,
    Layout,
    assign_pictures,
    choose_cameras,
    read_rig,
)
from psfs.footage.media import list_images
from psfs.footage.settings import SequenceSettings

#: The pelvis moves about 14 mm per frame, which suits a walk at 60 Hz; no file states the rate.
_FPS = 60.0


def _matches(folder: Path, settings: SequenceSettings) -> bool:
    return (folder / "CALIB").is_dir() and any(folder.glob("CAM*/"))


def _list_pictures(folder: Path, prefix: str) -> Found:
    """List the images by camera name: CAM1 and FG1 belong to Camera1.cal."""
    folders = [path for path in folder.glob(f"{prefix}[0-9]*") if path.is_dir()]
    folders.sort(key=lambda path: natural_key(path.name))
    found = {f"Camera{name_tokens(path.name)[-1]}": list_images(path) for path in folders}
    empty = [name for name, images in found.items() if not images]
    if empty:
        raise InputError(f"{folder}: no images for {', '.join(empty)} in {prefix}*")
    return found


def _read(folder: Path, settings: SequenceSettings) -> Footage:
    images, masks = _list_pictures(folder, "CAM"), _list_pictures(folder, "FG")
    calibration = folder / (settings.calibration or "CALIB")
    rig = read_rig(calibration, settings, images, folder / "CAM*")
    image_media, notes = assign_pictures(rig, images, folder / "CAM*", settings)
    if settings.fps == _FPS:
        notes = [*notes, f"{_FPS:g} frames per second fit the walk; no file states them"]
    mask_media = None
    if masks:
        mask_media, remarks = assign_pictures(rig, masks, folder / "FG*", settings)
        notes = notes + remarks
    return Footage(
        choose_cameras(rig, settings), rig.unit, images=image_media, masks=mask_media, notes=notes
    )


BODYTRACK = Layout("bodytrack", _matches, _read, SequenceSettings(fps=_FPS))
