"""Readers for calibration files, one small module per format."""

from __future__ import annotations

from pathlib import Path

from cl import InputError, MissingFileError
from psfs.cameras.calibration.common import Size, Sizes, read_text
from psfs.cameras.calibration.filestorage import read_easymocap, read_filestorage
from psfs.cameras.calibration.humaneva import read_humaneva
from psfs.cameras.calibration.middlebury import read_middlebury
from psfs.cameras.calibration.projections import read_projections
from psfs.cameras.calibration.toml_tables import read_toml_tables
from psfs.cameras.camera import CameraRig
from psfs.cameras.names import natural_key
from psfs.cameras.units import Unit

__all__ = [
    "Size",
    "Sizes",
    "find_calibration",
    "read_calibration",
    "read_easymocap",
    "read_filestorage",
    "read_humaneva",
    "read_middlebury",
    "read_projections",
    "read_toml_tables",
]

_STORAGE = (".xml", ".yml", ".yaml", ".json")
#: Names by which a calibration is looked for inside a folder, the surest first.
_PATTERNS = (
    "calibration.toml",
    "[Cc]alib*.toml",
    "intri.yml",
    "[Cc]alib*.xml",
    "[Cc]alib*.y*ml",
    "[Cc]alib*.json",
    "*_par.txt",
    "*projection*.txt",
    "[Cc]alib*.txt",
    "[Cc]alib*/",
    "CALIB/",
)


def find_calibration(folder: Path) -> Path | None:
    """Return the calibration file or folder inside `folder` by its usual names, or None.

    Raises InputError when several have equal claims.
    """
    for pattern in _PATTERNS:
        found = sorted(folder.glob(pattern.rstrip("/")))
        found = [path for path in found if path.is_dir() == pattern.endswith("/")]
        found = [path for path in found if path.is_file() or _camera_files(path)]
        if len(found) == 1:
            return found[0]
        if found:
            names = ", ".join(path.name for path in found)
            raise InputError(f"{folder}: several calibrations ({names}); choose by `calibration`")
    return None


def read_calibration(path: str | Path, unit: Unit | None = None, sizes: Sizes = None) -> CameraRig:
    """Return the cameras of a calibration file or folder, its format recognised, in metres.

    unit: what the numbers mean, for files that do not say; else the format's own. sizes:
    picture sizes where the file has none. The axes stay as in the file. Raises InputError
    naming the file, what was found and what was expected; MissingFileError if there is none.
    """
    path = Path(path)
    if not path.exists():
        raise MissingFileError(f"{path}: no such calibration file")
    if path.name in ("intri.yml", "extri.yml"):
        path = path.parent
    if path.is_dir():
        return _read_folder(path, unit, sizes)
    suffix = path.suffix.lower()
    if suffix == ".toml":
        return read_toml_tables(path, unit, sizes)
    if suffix in _STORAGE:
        return read_filestorage([path], unit, sizes)
    if suffix == ".cal":
        return read_humaneva([path], unit, sizes)
    words = [line.split() for line in read_text(path).splitlines() if line.strip()]
    if words and len(words[0]) == 1 and len(words) > 1 and len(words[1]) > 1:
        return read_middlebury(path, unit, sizes)
    return read_projections(path, unit, sizes)


def _camera_files(folder: Path) -> list[Path]:
    """Return the files of one camera each in a folder, in natural order of their names."""
    files = [path for path in folder.iterdir() if path.suffix.lower() in (".cal", *_STORAGE)]
    return sorted(files, key=lambda path: natural_key(path.name))


def _read_folder(folder: Path, unit: Unit | None, sizes: Sizes) -> CameraRig:
    if (folder / "intri.yml").exists():
        return read_easymocap(folder, unit, sizes)
    files = _camera_files(folder)
    suffixes = {path.suffix.lower() for path in files}
    if suffixes == {".cal"}:
        return read_humaneva(files, unit, sizes)
    if len(suffixes) == 1:
        return read_filestorage(files, unit, sizes)
    raise InputError(
        f"{folder}: {len(files)} camera files; expected .cal or OpenCV xml/yml/json files, "
        "one per camera and all of one kind"
    )
