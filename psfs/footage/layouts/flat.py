"""A flat folder: a calibration and pictures whose names contain the cameras' names.

`silh_cam01_00023.pbm` belongs to camera `cam01`. Several images of a camera are its frames, in
order.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cl import InputError
from psfs.cameras.calibration import find_calibration, read_calibration
from psfs.cameras.calibration.common import Size
from psfs.cameras.names import contains_name, match_files_to_cameras, name_tokens, natural_key
from psfs.footage.layouts.common import (
    Footage,
    Found,
    Layout,
    assemble,
    choose_cameras,
    measure_sizes,
)
from psfs.footage.layouts.native import find_settings_calibration
from psfs.footage.media import IMAGE_SUFFIXES, VIDEO_SUFFIXES, list_media
from psfs.footage.settings import SequenceSettings

_MASK_WORDS = {"mask", "masks", "silh", "silhouette", "fg", "foreground"}
_BACKGROUND_WORDS = {"background", "bg", "empty"}


def _matches(folder: Path, settings: SequenceSettings) -> bool:
    """Return whether there is a calibration, or a video, for which reading will ask for one."""
    videos = (path for path in folder.iterdir() if path.suffix.lower() in VIDEO_SUFFIXES)
    return bool(settings.calibration or find_calibration(folder) or any(videos))


def _kind(path: Path) -> str:
    words = set(name_tokens(path.stem))
    if words & _MASK_WORDS or path.suffix.lower() == ".pbm":
        return "masks"
    return "background" if words & _BACKGROUND_WORDS else "images"


def _list_pictures(folder: Path, cameras: Sequence[str]) -> dict[str, dict[str, list[Path]]]:
    """List the files by kind and camera."""
    found: dict[str, dict[str, list[Path]]] = {"images": {}, "masks": {}, "background": {}}
    for path in sorted(folder.iterdir(), key=lambda path: natural_key(path.name)):
        if path.suffix.lower() not in IMAGE_SUFFIXES | VIDEO_SUFFIXES:
            continue
        owners = [name for name in cameras if contains_name(path.stem, name)]
        if len(owners) > 1:
            raise InputError(f"{path}: the name fits several cameras: {', '.join(owners)}")
        if owners:
            found[_kind(path)].setdefault(owners[0], []).append(path)
    return found


def _assign_all_pictures(
    folder: Path, cameras: Sequence[str]
) -> tuple[dict[str, dict[str, Any]], str | None]:
    """Return `_list_pictures` and a remark.

    If no name contains a camera's, but there are as many pictures or videos as cameras, they are
    assigned in order.
    """
    found = _list_pictures(folder, cameras)
    if any(found.values()):
        return found, None
    files = {name: own for name, own in list_media(folder).items() if own[0].parent == folder}
    if len(files) != len(cameras) or any(len(paths) > 1 for paths in files.values()):
        return found, None
    pairs, note = match_files_to_cameras(cameras, list(files), str(folder))
    for camera, name in pairs.items():
        found[_kind(files[name][0])][camera] = files[name]
    return found, note


def _read(folder: Path, settings: SequenceSettings) -> Footage:
    calibration = find_settings_calibration(folder, settings)

    def sizes(names: Sequence[str]) -> list[Size]:
        kinds, _ = _assign_all_pictures(folder, names)
        return measure_sizes({**kinds["masks"], **kinds["images"]}, folder, settings, names)

    calibrated = read_calibration(calibration, settings.unit, sizes)
    names = choose_cameras(calibrated, settings).names
    notes = list(calibrated.notes)
    whole: dict[str, tuple[Found, Path]] = {}
    kinds, guess = _assign_all_pictures(folder, calibrated.names)
    notes += [guess] if guess else []
    for kind, every in kinds.items():
        chosen = {name: files for name, files in every.items() if name in names}
        if len(chosen) == len(names):
            whole[kind] = chosen, folder
        elif chosen:
            missing = [name for name in names if name not in chosen]
            notes.append(f"{kind} are not used: none for {', '.join(missing)}")
    if not whole.keys() & {"images", "masks"}:
        raise InputError(
            f"{folder}: no pictures for every camera ({', '.join(names)}); expected "
            "videos/, images/<camera>/, masks/<camera>/ or files whose names contain the cameras'"
        )
    return assemble(calibrated, settings, whole, notes=notes)


FLAT = Layout("flat", _matches, _read)
