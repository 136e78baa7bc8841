"""The folder of PARSEC's bodytrack: CALIB/Camera*.cal, CAM*/image*.bmp, FG*/image*.bmp."""

from __future__ import annotations

from pathlib import Path

from cl import InputError
from psfs.cameras.names import name_tokens, natural_key
from psfs.footage.layouts.common import Footage, Found, Layout, assigned, chosen, read_rig
from psfs.footage.media import images_in
from psfs.footage.settings import Settings

#: The pelvis moves about 14 mm per frame, which fits a walk at 60 Hz; no file states it.
_FPS = 60.0


def _matches(folder: Path, settings: Settings) -> bool:
    return (folder / "CALIB").is_dir() and any(folder.glob("CAM*/"))


def _pictures(folder: Path, prefix: str) -> Found:
    """Return image lists by camera name: CAM1 and FG1 belong to Camera1.cal."""
    folders = [path for path in folder.glob(f"{prefix}[0-9]*") if path.is_dir()]
    folders.sort(key=lambda path: natural_key(path.name))
    found = {f"Camera{name_tokens(path.name)[-1]}": images_in(path) for path in folders}
    empty = [name for name, images in found.items() if not images]
    if empty:
        raise InputError(f"{folder}: no images for {', '.join(empty)} in {prefix}*")
    return found


def _read(folder: Path, settings: Settings) -> Footage:
    images, masks = _pictures(folder, "CAM"), _pictures(folder, "FG")
    calibration = folder / (settings.calibration or "CALIB")
    rig = read_rig(calibration, settings, images, folder / "CAM*")
    image_media, notes = assigned(rig, images, folder / "CAM*", settings)
    if settings.fps == _FPS:
        notes = [*notes, f"{_FPS:g} frames per second fit the walk; no file states them"]
    mask_media = None
    if masks:
        mask_media, remarks = assigned(rig, masks, folder / "FG*", settings)
        notes = notes + remarks
    return Footage(
        chosen(rig, settings), rig.unit, images=image_media, masks=mask_media, notes=notes
    )


BODYTRACK = Layout("bodytrack", _matches, _read, Settings(fps=_FPS))
