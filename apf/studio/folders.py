"""The folders that a page may open: those under the folders given to the command."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from apf.report.summary import SUMMARY
from apf.tracking.people import holds_people, list_people
from apf.tracking.track import PARTS
from cl import InputError, MissingFileError, UserError
from psfs.footage.layouts import LAYOUTS
from psfs.footage.layouts.flat import FLAT
from psfs.footage.layouts.native import NATIVE, find_settings_calibration
from psfs.footage.layouts.uncalibrated import list_pictures
from psfs.footage.media import IMAGE_SUFFIXES, VIDEO_SUFFIXES
from psfs.footage.settings import SequenceSettings
from psfs.request import CALIBRATION

#: Levels below a given folder that are searched, and the most folders that are listed.
_DEPTH, _MOST = 3, 500
#: Parts of a take or a run, which are not searched.
_INSIDE = ("clouds", "parts", "videos", "background", "truth_masks", "keypoints")


@dataclass(frozen=True)
class Found:
    """A folder that can be opened. kind: take, views, track or voxels. name: relative to the folder
    that was given."""

    path: Path
    kind: str
    name: str


class Roots:
    """The folders given to the command; nothing outside them is opened. Raises MissingFileError if
    one does not exist."""

    def __init__(self, *folders: Path) -> None:
        self._folders = [folder.resolve() for folder in folders]
        for folder in self._folders:
            if not folder.is_dir():
                raise MissingFileError(f"{folder}: no folder; expected one of takes or results")

    def add(self, folder: Path) -> None:
        """Allow another folder, which the command made itself."""
        if (folder := folder.resolve()) not in self._folders:
            self._folders.append(folder)

    def check(self, path: Path) -> Path:
        """Return the resolved path. Raises InputError if it lies outside the given folders."""
        resolved = path.resolve()
        if not any(resolved.is_relative_to(folder) for folder in self._folders):
            raise InputError(
                f"{path}: outside of the folders that were opened; expected one inside"
            )
        return resolved

    def find(self) -> list[Found]:
        """Return what can be opened, in the order of the names; links out of the folders are left
        out."""
        found: dict[Path, Found] = {}
        for path, name in self._walk():
            if len(found) < _MOST and (kind := find_kind(path)) is not None:
                found.setdefault(path, Found(path, kind, name))
        return list(found.values())

    def find_calibrations(self) -> dict[str, Path]:
        """Return the files of cameras by the names of their folders."""
        files = {name: path / CALIBRATION for path, name in self._walk()}
        return {name: path for name, path in files.items() if path.is_file()}

    def _walk(self) -> Iterator[tuple[Path, str]]:
        """Yield the folders that may be opened, with their names."""
        for root in self._folders:
            for where, inner, _ in os.walk(root, followlinks=True):
                path = Path(where)
                steps = path.relative_to(root).parts
                searched = inner if len(steps) < _DEPTH else []
                inner[:] = sorted(n for n in searched if n[0] != "." and n not in _INSIDE)
                if path.resolve().is_relative_to(root):
                    yield path, "/".join(steps) or root.name


def find_kind(folder: Path) -> str | None:
    """Return what a folder holds: a `track` of one person or of several, `voxels` of psfs
    reconstruct, a `take`, `views` without a calibration; None for anything else."""
    if (folder / "track.npz").is_file() or next(folder.glob(PARTS), None):
        return "track"
    if holds_people(folder) or list_people(folder):
        return "track"
    if (folder / SUMMARY).is_file() and (folder / "clouds").is_dir():
        return "voxels"
    if _is_take(folder):
        return "take"
    try:
        found = list_pictures(folder)
    except UserError:
        return None
    lasting = [len(of) > 1 or of[0].suffix.lower() in VIDEO_SUFFIXES for of in found.values()]
    return "views" if sum(lasting) > 1 else None  # videos, or pictures over time


def _is_take(folder: Path) -> bool:
    """Return whether a folder has the layout of a take, and a calibration if that needs one."""
    try:
        layout = next((one for one in LAYOUTS if one.matches(folder, SequenceSettings())), None)
        if layout in (NATIVE, FLAT):
            settings = SequenceSettings.read(folder / "sequence.toml")
            find_settings_calibration(folder, settings)
        if layout is FLAT:  # cameras alone have a picture of them at most
            suffixes = [path.suffix.lower() for path in folder.iterdir()]
            return sum(suffix in IMAGE_SUFFIXES | VIDEO_SUFFIXES for suffix in suffixes) > 1
    except MissingFileError:
        return False
    except UserError:  # a file that cannot be read
        return True
    return layout is not None
