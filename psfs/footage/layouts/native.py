"""The native folder: a calibration beside `videos/*`, `images/<camera>/*` or `masks/<camera>/*`.

`background/*` holds a video or image per camera, or a subfolder of images per camera.
"""

from __future__ import annotations

from pathlib import Path

from cl import InputError, MissingFileError
from psfs.cameras.calibration import find_calibration
from psfs.cameras.names import join_names, rename_files
from psfs.common.ranges import NAMED
from psfs.footage.layouts.common import Footage, Layout, assemble, read_rig
from psfs.footage.media import IMAGE_SUFFIXES, VIDEO_SUFFIXES, list_media
from psfs.footage.settings import SequenceSettings

_IMAGES = ("videos", "images")


def _matches(folder: Path, settings: SequenceSettings) -> bool:
    return any((folder / name).is_dir() for name in (*_IMAGES, "masks"))


def find_settings_calibration(folder: Path, settings: SequenceSettings) -> Path:
    """Return the calibration that the settings name, else the one in the folder."""
    if settings.calibration is not None:
        return folder / settings.calibration
    path = find_calibration(folder)
    if path is None:
        raise MissingFileError(
            f"{folder}: no calibration; expected calibration.toml, or a path as `calibration`. "
            "Where there is none, psfs calibrate makes one: docs/from_phones.md"
        )
    return path


def _read(folder: Path, settings: SequenceSettings) -> Footage:
    calibration = find_settings_calibration(folder, settings)
    folders = {name: folder / name for name in (*_IMAGES, "masks", "background")}
    found = {
        name: rename_files(
            list_media(path), settings.files, None if name == "background" else str(path)
        )
        for name, path in folders.items()
        if path.is_dir()
    }
    images = next((name for name in _IMAGES if found.get(name)), None)
    primary = images or "masks"
    if not found.get(primary):
        there = [path for place in folders.values() if place.is_dir() for path in place.iterdir()]
        some = join_names(str(path.relative_to(folder)) for path in sorted(there)[:NAMED])
        raise InputError(
            f"{folder}: no pictures in videos/, images/<camera>/ or masks/<camera>/; found {some}; "
            f"expected {join_names(sorted(VIDEO_SUFFIXES | IMAGE_SUFFIXES))}"
        )
    rig = read_rig(calibration, settings, found[primary], folders[primary])
    notes = list(rig.notes)
    if all(found.get(name) for name in _IMAGES):
        notes.append(f"{folder}: {_IMAGES[0]}/ is used; {_IMAGES[1]}/ is ignored")
    kinds = {"images": images or "", "masks": "masks", "background": "background"}
    files = {kind: (found.get(name, {}), folder / name) for kind, name in kinds.items()}
    return assemble(rig, settings, files, notes=notes)


NATIVE = Layout("native", _matches, _read)
