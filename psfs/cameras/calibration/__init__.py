"""Read camera calibrations: a reader per file format."""

from __future__ import annotations

from pathlib import Path

from cl import InputError, MissingFileError
from psfs.cameras.calibration.common import (
    Calibration,
    Sizes,
    read_text,
)
from psfs.cameras.calibration.filestorage import read_easymocap, read_filestorage
from psfs.cameras.calibration.layouts import read_layout
from psfs.cameras.calibration.number_lists import (
    SUFFIXES,
    TSAI,
    looks_like_surrey,
    looks_like_tsai,
    read_camera_files,
    read_humaneva,
    read_middlebury,
    read_surrey,
    read_tsai,
)
from psfs.cameras.calibration.photogrammetry import read_colmap, read_transforms
from psfs.cameras.calibration.projections import read_matlab, read_projections
from psfs.cameras.calibration.toml_tables import read_toml_tables
from psfs.cameras.calibration.xml_files import (
    OPTITRACK,
    QUALISYS,
    VICON,
    looks_like_qualisys,
    read_xml,
)
from psfs.cameras.names import natural_key
from psfs.cameras.units import Unit
from psfs.common.reading import open_input

#: Endings of COLMAP's files.
_MODELS = (".txt", ".bin")
_STORAGE = (".xml", ".yml", ".yaml", ".json")
#: Endings of files of `LAYOUTS`.
_TABLES = (".json", ".yml", ".yaml", ".mat", ".calib", ".calibration", ".txt")
#: Text files whose names begin like this hold no cameras.
_NO_CAMERAS = ("readme", "license", "sequence", "settings", "original_readme")
#: Usual names of a calibration inside a folder, the most specific pattern first.
_PATTERNS = (
    "calibration.toml",
    "[Cc]alib*.toml",
    "camera_array.toml",
    "transforms*.json",
    "intri.yml",
    "[Cc]alib*.xml",
    "[Cc]alib*.y*ml",
    "[Cc]alib*.json",
    "camchain*.y*ml",
    "*.calibration",
    "*.xcp",
    "*.mcal",
    "*_par.txt",
    "*projection*.txt",
    "[Cc]alib*.txt",
    "*[Pp]arameters*.txt",
    "[Cc]alib*.mat",
    "*camera*.mat",
    "*P*.mat",
    "[Cc]alib*/",
    "CALIB/",
    "[Cc]ameras/",
    "sparse/",
    "sparse/0/",
)


def find_calibration(folder: Path) -> Path | None:
    """Find the calibration file or folder inside `folder` by its usual names; None without one.

    Raises InputError when one pattern matches several.
    """
    for pattern in _PATTERNS:
        files = sorted(folder.glob(pattern.rstrip("/")))
        files = [path for path in files if path.is_dir() == pattern.endswith("/")]
        files = [path for path in files if not path.is_dir() or _holds_cameras(path)]
        if len(files) == 1:
            return files[0]
        if files:
            names = ", ".join(path.name for path in files)
            raise InputError(f"{folder}: several calibrations ({names}); choose by `calibration`")
    models = ((folder / f"{name}{ending}" for name in ("cameras", "images")) for ending in _MODELS)
    whole = any(all(path.is_file() for path in model) for model in models)
    return folder if whole or any(folder.glob("*.pa")) else None


def read_calibration(
    path: str | Path, unit: Unit | None = None, sizes: Sizes = None
) -> Calibration:
    """Read a calibration file, a folder of a file per camera, or the calibration in a folder by its
    usual name, of any supported format, converted to metres.

    unit: length unit of a file that does not state its own; None: the usual one of the format.
    sizes: picture sizes, for files without them. The axes stay as in the file. Raises InputError
    with the file, what was found and what was expected; MissingFileError if there is no file.
    """
    path = Path(path)
    if not path.exists():
        raise MissingFileError(f"{path}: no such calibration file")
    if path.is_dir() and not _holds_cameras(path):
        path = find_calibration(path) or path
    suffix, name = path.suffix.lower(), path.name
    models = [f"{what}{ending}" for what in ("cameras", "images") for ending in _MODELS]
    if name in ("intri.yml", "extri.yml", *models):
        path = path.parent
    if path.is_dir():
        return _read_folder(path, unit, sizes)
    open_input(path, "a calibration").close()
    if suffix == ".toml":
        return read_toml_tables(path, unit, sizes)
    if suffix == ".json" and name.startswith("transforms"):
        return read_transforms(path, unit, sizes)
    if suffix in _TABLES and (known := read_layout([path], unit, sizes)) is not None:
        return known
    if suffix in (VICON, OPTITRACK):
        return read_xml(path, unit)
    if suffix == ".mat":
        return read_matlab(path, unit, sizes)
    if suffix in _STORAGE:
        return read_filestorage([path], unit, sizes)
    if _is_tsai(path):
        return read_tsai([path], unit, sizes)
    if suffix == ".cal" and not looks_like_surrey(read_text(path)):
        return read_humaneva([path], unit, sizes)
    return _read_text_file(path, unit, sizes)


def _is_tsai(path: Path) -> bool:
    suffix = path.suffix.lower()
    return suffix in TSAI or (suffix in (".cal", ".txt") and looks_like_tsai(read_text(path)))


def _read_text_file(path: Path, unit: Unit | None, sizes: Sizes) -> Calibration:
    text = read_text(path)
    if looks_like_qualisys(text):
        return read_xml(path, unit)
    if looks_like_surrey(text):
        return read_surrey(path, unit)
    words = [line.split() for line in text.splitlines() if line.strip()]
    if words and len(words[0]) == 1 and len(words) > 1 and len(words[1]) > 1:
        return read_middlebury(path, unit, sizes)
    return read_projections(path, unit, sizes)


def _holds_cameras(folder: Path) -> bool:
    return _holds_model(folder) or bool(_camera_files(folder)) or any(folder.glob("*_params.mat"))


def _holds_model(folder: Path) -> bool:
    return any((folder / f"cameras{ending}").is_file() for ending in _MODELS)


def _camera_files(folder: Path) -> list[Path]:
    """List the files in a folder that hold one camera each, in natural order of their names."""
    suffixes = (".cal", *TSAI, *_STORAGE, *SUFFIXES, ".calib")
    files = [path for path in folder.iterdir() if path.suffix.lower() in suffixes]
    files = [path for path in files if not path.stem.lower().startswith(_NO_CAMERAS)]
    if any(path.suffix.lower() == ".pa" for path in files):  # beside pictures and other files
        files = [path for path in files if path.suffix.lower() == ".pa"]
    return sorted(files, key=lambda path: natural_key(path.name))


def _read_folder(folder: Path, unit: Unit | None, sizes: Sizes) -> Calibration:
    if (folder / "intri.yml").exists():
        return read_easymocap(folder, unit, sizes)
    if _holds_model(folder):
        return read_colmap(folder, unit)
    files = _camera_files(folder)
    if len(files) == 1 and files[0].name.endswith(QUALISYS):
        return read_xml(files[0], unit)
    tables = files or sorted(folder.glob("*_params.mat"), key=lambda path: natural_key(path.name))
    if tables and (known := read_layout(tables, unit, sizes)) is not None:
        return known
    suffixes = {path.suffix.lower() for path in files}
    if len(suffixes) == 1 and _is_tsai(files[0]):
        return read_tsai(files, unit, sizes)
    if suffixes == {".cal"}:
        return read_humaneva(files, unit, sizes)
    if len(suffixes) == 1 and suffixes <= set(SUFFIXES):
        return read_camera_files(files, unit, sizes)
    if len(suffixes) == 1:
        return read_filestorage(files, unit, sizes)
    raise InputError(
        f"{folder}: {len(files)} camera files; expected .cal, .cpar, .pa, .txt or OpenCV "
        "xml/yml/json files, one per camera and all of one kind, or COLMAP's cameras.txt and "
        "images.txt"
    )
