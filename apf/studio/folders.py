"""The folders that a page may open: those under the folders given to the command."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from apf.report.summary import SUMMARY
from apf.tracking.track import PARTS
from cl import InputError, MissingFileError, UserError
from psfs.footage.layouts import LAYOUTS
from psfs.footage.settings import SequenceSettings

#: Levels below a given folder that are searched, and the most folders that are listed.
_DEPTH, _MOST = 3, 500
#: Parts of a take or a run, which are not searched.
_INSIDE = ("clouds", "parts", "videos", "background", "truth_masks", "keypoints")


@dataclass(frozen=True)
class Found:
    """A folder that can be opened. kind: take, track or voxels. name: relative to the folder that
    was given."""

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
        self._folders.append(folder.resolve())

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
        for root in self._folders:
            for path in _walk(root, _DEPTH):
                kind = find_kind(path)
                if kind is None or len(found) >= _MOST or not path.resolve().is_relative_to(root):
                    continue
                name = path.relative_to(root).as_posix()
                found.setdefault(path, Found(path, kind, root.name if name == "." else name))
        return list(found.values())


def find_kind(folder: Path) -> str | None:
    """Return what a folder holds: a `track` of one person or of several, `voxels` of psfs
    reconstruct, a `take`; None for anything else."""
    if (folder / "track.npz").is_file() or next(folder.glob(PARTS), None):
        return "track"
    if list_people(folder):
        return "track"
    if (folder / SUMMARY).is_file() and (folder / "clouds").is_dir():
        return "voxels"
    return "take" if _is_take(folder) else None


def list_people(folder: Path) -> list[Path]:
    """Return the folders of the people of a run of several, in their order."""
    found = [path for path in folder.glob("person*") if (path / "track.npz").is_file()]
    return sorted(found, key=lambda path: (len(path.name), path.name))


def _is_take(folder: Path) -> bool:
    """Return whether a folder has the layout of a take."""
    try:
        return any(layout.matches(folder, SequenceSettings()) for layout in LAYOUTS)
    except UserError:  # a calibration that cannot be read
        return True


def _walk(folder: Path, depth: int) -> Iterator[Path]:
    yield folder
    if depth == 0:
        return
    try:
        inner = sorted(entry for entry in folder.iterdir() if entry.is_dir())
    except OSError:  # a folder that may not be read
        return
    for entry in inner:
        if not entry.name.startswith(".") and entry.name not in _INSIDE:
            yield from _walk(entry, depth - 1)
