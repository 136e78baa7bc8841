"""Folders of uncalibrated cameras.

`videos/*`, `images/<camera>/*`, or videos and folders of pictures in the folder itself, one per
camera and named after it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cl import InputError
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.names import rename_files
from psfs.common.files import check_folder
from psfs.footage.layouts.common import Footage, Found, assign_pictures
from psfs.footage.media import Media, list_media, open_media
from psfs.footage.settings import SequenceSettings

LAYOUT = "uncalibrated"
#: Places of pictures, the most specific first; then names of folders that hold other things.
_PLACES = ("videos", "images", ".")
_OTHERS = ("background", "masks", "intrinsics", "truth", "pose")


def list_pictures(folder: Path) -> Found:
    """List the pictures by camera.

    Raises InputError if there are none, MissingFileError if there is no such folder.
    """
    wanted = "expected videos/, images/<camera>/, or a video or folder of pictures per camera"
    check_folder(folder, wanted)
    for place in _PLACES:
        if (folder / place).is_dir():
            found = list_media(folder / place)
            found = {name: paths for name, paths in found.items() if name not in _OTHERS}
            if found:
                return found
    inside = [
        path.name
        for path in sorted(folder.iterdir())
        if any((path / place).is_dir() for place in _PLACES[:-1])
    ]
    hint = f", as its folder {inside[0]} has" if inside else ""
    raise InputError(f"{folder}: no pictures; {wanted}{hint}")


def read_uncalibrated(
    folder: Path, settings: SequenceSettings, silhouettes: bool = False
) -> Footage:
    """Read the chosen cameras' pictures; of the rig only names and sizes are meaningful.

    silhouettes: read the pictures of the empty scene in `background/` and the `masks/`, too, where
    there are some. Raises InputError as `list_pictures` does.
    """
    found = rename_files(list_pictures(folder), settings.files, str(folder))
    names = list(found) if settings.cameras is None else list(settings.cameras)
    missing = [name for name in names if name not in found]
    if missing:
        raise InputError(f"{folder}: no camera {', '.join(missing)}; found {', '.join(found)}")
    media = tuple(open_media(name, found[name]) for name in names)
    rig = CameraRig(tuple(make_nominal_camera(item.name, item.size) for item in media))
    others: dict[str, tuple[Media, ...]] = {}
    for name in ("background", "masks") if silhouettes else ():
        if (folder / name).is_dir() and (own := list_media(folder / name)):
            own = rename_files(own, settings.files)
            others[name], _ = assign_pictures(rig, own, folder / name, settings, extras=True)
    return Footage(
        rig, images=media, masks=others.get("masks"), background=others.get("background")
    )


def make_nominal_camera(name: str, size: tuple[int, int]) -> Camera:
    K = np.array([[max(size), 0, size[0] / 2], [0, max(size), size[1] / 2], [0, 0, 1.0]])
    return Camera(name, K, np.zeros(5), np.eye(3), np.zeros(3), size)
