"""Lenses of cameras that a person calibrates: `--intrinsics`, `--field-of-view`, or metadata."""

from __future__ import annotations

from pathlib import Path

from cl import InputError
from psfs.calibration.intrinsics import (
    make_cameras_by_angle,
    make_cameras_by_metadata,
    read_intrinsics,
)
from psfs.cameras.calibration import find_calibration
from psfs.cameras.camera import Camera
from psfs.cameras.names import join_names, match_files_to_cameras
from psfs.cli.commandline import remark
from psfs.footage.media import IMAGE_SUFFIXES, VIDEO_SUFFIXES, list_media
from psfs.request import PersonRequest
from psfs.sequence import Sequence

_EXPECTED = (
    "expected --intrinsics PATH, a calibration of which only the lenses are taken, as psfs "
    "calibrate --board writes, or a folder with a photo by each camera; or --field-of-view "
    "DEGREES, of the pictures' longer side: see docs/from_phones.md"
)


def read_lenses(request: PersonRequest, views: Sequence) -> tuple[list[Camera], bool]:
    """Return the cameras with the intrinsics of --intrinsics, --field-of-view or the metadata of
    photos or of the footage, and whether these are kept, rather than refined."""
    if request.intrinsics is not None and request.field_of_view is not None:
        raise InputError("--intrinsics and --field-of-view; expected one of them")
    if request.field_of_view is not None:
        return make_cameras_by_angle(views.rig, request.field_of_view), False
    path: Path | None = request.intrinsics
    if path is None:
        images = views.footage.images or ()
        return _read_metadata(views, {media.name: media.paths[0] for media in images}), False
    if path.suffix.lower() in IMAGE_SUFFIXES | VIDEO_SUFFIXES and path.is_file():
        raise InputError(f"{path}: a picture or video; {_EXPECTED}")
    if path.is_dir() and find_calibration(path) is None:
        return _read_metadata(views, _list_photos(path, views.rig.names)), False
    return read_intrinsics(path, views.rig, None), True


def _list_photos(folder: Path, names: list[str]) -> dict[str, Path]:
    """Return a photo, or a video, in the folder by each camera."""
    found = list_media(folder)
    if not found:
        raise InputError(f"{folder}: holds no calibration and no photos; {_EXPECTED}")
    pairs, _ = match_files_to_cameras(names, list(found), str(folder), names)
    return {name: found[pairs[name]][0] for name in names}


def _read_metadata(views: Sequence, pictures: dict[str, Path]) -> list[Camera]:
    try:
        cameras, stated = make_cameras_by_metadata(views.rig, pictures)
    except InputError as error:
        raise InputError(
            f"no lenses are stated ({error}, which iPhones' videos and most photos have); "
            f"{_EXPECTED}"
        ) from None
    angles = join_names(
        f"{name} {lens.degrees:.0f} degrees ({lens.source})" for name, lens in stated.items()
    )
    text = "angles of view by metadata, to be refined: "
    remark("note", "cyan", f"{text}{angles}; a video that is stabilised shows up to a fifth less")
    return cameras
