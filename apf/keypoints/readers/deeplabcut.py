"""Read tables of a file per camera: DeepLabCut's, and SLEAP's analysis.

DeepLabCut's columns are by scorer, (individual,) part and coordinate: a csv has these names in its
first rows, one row per level; an h5 is a pandas table. SLEAP's csv has a row per track and frame,
its h5 arrays `tracks` and `point_scores`. An h5 needs the extra `deeplabcut`.
"""

from __future__ import annotations

import csv
import io
from codecs import BOM_UTF8
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from apf.keypoints.readers.raw import RawKeypoints
from cl import InputError
from cl.errors import pip_command
from psfs.cameras.names import join_names
from psfs.common.files import MOST_BYTES, read_text
from psfs.common.ranges import MOST_FRAMES
from psfs.common.reading import open_input, parsing

#: Endings of the files.
ENDINGS = (".csv", ".h5", ".hdf5")
_LEVELS = ("individuals", "bodyparts", "coords")
_COORDINATES = ("x", "y", "likelihood")
_EXPECTED = "DeepLabCut's header rows scorer, bodyparts, coords"
#: How SLEAP's csv begins.
_SLEAP = [b"track", b"frame_idx"]
#: What follows the video's name in a file's name: cam1DLC_resnet50_...
_SCORER = "DLC"

#: A column: individual, body part, coordinate.
Column = tuple[str, str, str]


def is_deeplabcut(path: Path) -> bool:
    """Return whether a .csv begins as DeepLabCut's or SLEAP's do; an .h5 is assumed to be one."""
    if path.suffix.lower() != ".csv":
        return path.suffix.lower() in ENDINGS
    return _is_sleap(path) or _read_head(path)[0].strip() == b"scorer"


def _is_sleap(path: Path) -> bool:
    return path.suffix.lower() == ".csv" and _read_head(path)[:2] == _SLEAP


def _read_head(path: Path) -> list[bytes]:
    """Return the first cells of a text; none of a file that cannot be read."""
    with suppress(InputError), open_input(path) as file:
        return file.readline(100).removeprefix(BOM_UTF8).split(b",")
    return [b""]


def read_deeplabcut(path: Path, files: Sequence[Path]) -> RawKeypoints:
    """Read the tables of all cameras; path: named in errors.

    If a table exists as .csv and as .h5, the .csv is read. Raises InputError naming the file that
    is wrong.
    """
    by_stem: dict[str, Path] = {}
    for file in sorted(files, key=lambda file: ENDINGS.index(file.suffix.lower())):
        by_stem.setdefault(file.stem, file)
    views: dict[str, np.ndarray] = {}
    parts_of: dict[str, tuple[str, ...]] = {}
    for stem, file in by_stem.items():
        columns, values = _read_csv(file) if file.suffix.lower() == ".csv" else _read_h5(file)
        name = stem.split(_SCORER)[0].rstrip("_-. ") or stem
        if name in views:
            raise InputError(
                f"{path}: {join_names(by_stem)} are several tables of one video, {name}"
            )
        parts_of[name], views[name] = _arrange_columns(file, columns, values)
    first = next(iter(parts_of.values()))
    for name, parts in parts_of.items():
        if set(parts) != set(first):
            raise InputError(
                f"{path}: body parts of {name} ({join_names(parts)}) are not those of "
                f"{next(iter(parts_of))} ({join_names(first)})"
            )
        views[name] = views[name][:, :, [parts.index(part) for part in first]]
    return RawKeypoints(path, first, views, sparse=all(map(_is_sleap, by_stem.values())))


def _read_csv(path: Path) -> tuple[list[Column], np.ndarray]:
    """Return columns and values (F, C) of a table with header rows; blank cells are NaN."""
    with parsing(path, "a table"):
        rows = list(csv.reader(io.StringIO(read_text(path, "a table", MOST_BYTES), newline="")))
    if rows and rows[0][:2] == [word.decode() for word in _SLEAP]:
        return _arrange_sleap(path, rows)
    heads: dict[str, list[str]] = {}
    while rows and rows[0] and rows[0][0].strip() in ("scorer", *_LEVELS):
        level, *cells = (cell.strip() for cell in rows.pop(0))
        heads[level] = cells
    if not {"bodyparts", "coords"} <= set(heads):
        raise InputError(f"{path}: has no {_EXPECTED}")
    width = len(heads["coords"])
    individuals = heads.get("individuals", [""] * width)
    columns = list(zip(individuals, heads["bodyparts"], heads["coords"], strict=False))
    values = np.full((len(rows), width), np.nan)
    for number, (row, cells) in enumerate(zip(values, rows, strict=True), len(heads) + 1):
        if len(cells) != width + 1:
            raise InputError(f"{path}: line {number} has {len(cells)} cells; expected {width + 1}")
        try:
            row[:] = [float(cell) if cell.strip() else np.nan for cell in cells[1:]]
        except ValueError as error:
            raise InputError(f"{path}: line {number}: {error}") from None
    return columns, values


def _arrange_sleap(path: Path, rows: list[list[str]]) -> tuple[list[Column], np.ndarray]:
    """Return columns and values (F, C) of SLEAP's rows: track, frame, the person's score, and x, y
    and score of each part."""
    names = [tuple(name.rsplit(".", 1)) for name in rows[0][3:]]
    axes = {"x": "x", "y": "y", "score": "likelihood"}
    if not names or any(len(name) != 2 or name[1] not in axes for name in names):
        raise InputError(f"{path}: has columns {join_names(rows[0])}; expected SLEAP's analysis")
    with parsing(path, "SLEAP's analysis"):
        frames = [int(row[1]) for row in rows[1:]]
        numbers = [[float(cell) if cell.strip() else np.nan for cell in r[3:]] for r in rows[1:]]
        tracks = list(dict.fromkeys(row[0] for row in rows[1:]))
        length = max(frames, default=-1) + 1
        if length > MOST_FRAMES:
            raise InputError(f"frame {length - 1}; expected at most {MOST_FRAMES}")
        values = np.full((length, len(tracks), len(names)), np.nan)
        for row, frame, cells in zip(rows[1:], frames, numbers, strict=True):
            values[frame, tracks.index(row[0])] = cells
    columns = [(track, part, axes[axis]) for track in tracks for part, axis in names]
    return columns, values.reshape(length, -1)


def _read_sleap(path: Path, file: Any) -> tuple[list[Column], np.ndarray]:
    """Return columns and values (F, C) of SLEAP's arrays in an open HDF5 file."""
    with parsing(path, "SLEAP's analysis"):
        places = np.asarray(file.root.tracks.read(), float)  # (tracks, x y, parts, frames)
        parts = [name.decode() for name in np.ravel(file.root.node_names.read())]
        scores = np.isfinite(places[:, 0]).astype(float)
        if "/point_scores" in file:
            scores = np.asarray(file.root.point_scores.read(), float)
        whole = np.concatenate([places, scores[:, None]], axis=1)
    columns = [
        (str(track), part, axis)
        for track in range(len(whole)) for axis in _COORDINATES for part in parts
    ]  # fmt: skip
    return columns, whole.reshape(-1, whole.shape[-1]).T


def _read_h5(path: Path) -> tuple[list[Column], np.ndarray]:
    """Return columns and values (F, C) of a pandas table. Raises InputError."""
    try:
        import pandas
        import tables
    except ImportError:
        raise InputError(
            f"{path}: reading DeepLabCut's .h5 needs pandas and tables "
            f"({pip_command('deeplabcut')}); its .csv needs nothing"
        ) from None
    with parsing(path, "a pandas table"):
        open_input(path).close()
        with tables.open_file(str(path)) as file:
            if "/tracks" in file and "/node_names" in file:
                return _read_sleap(path, file)
        table: Any = pandas.read_hdf(path)
    names = list(getattr(table.columns, "names", []))
    if not {"bodyparts", "coords"} <= set(names):
        raise InputError(
            f"{path}: its columns are by {join_names(map(str, names))}; no {_EXPECTED}"
        )
    columns = [
        tuple(str(key[names.index(level)]) if level in names else "" for level in _LEVELS)
        for key in table.columns
    ]
    return columns, table.to_numpy(np.float64)  # type: ignore[return-value]


def _arrange_columns(
    path: Path, columns: list[Column], values: np.ndarray
) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the body parts (K,) and their values (F, N, K, 3) of N individuals."""
    where = {column: number for number, column in enumerate(columns)}
    parts = tuple(dict.fromkeys(part for _, part, _ in columns))
    individuals = list(dict.fromkeys(individual for individual, _, _ in columns))
    if len(where) < len(columns) or not parts:
        raise InputError(f"{path}: has the same column twice, or none; expected {_EXPECTED}")
    strange = sorted({axis for *_, axis in columns} - set(_COORDINATES))
    if strange:
        quoted = repr(strange[0][:50])
        raise InputError(f"{path}: has a coordinate {quoted}; expected {join_names(_COORDINATES)}")
    out = np.full((len(values), len(individuals), len(parts), 3), np.nan)
    for n, individual in enumerate(individuals):
        for k, part in enumerate(parts):
            axes = [where.get((individual, part, axis)) for axis in _COORDINATES]
            if any(column is None for column in axes[:2]):
                if individual in ("", individuals[0]):
                    raise InputError(f"{path}: body part {part} has no x, y; expected {_EXPECTED}")
                continue  # parts of single animals in a table of several
            for axis, column in enumerate(axes):
                out[:, n, k, axis] = 1.0 if column is None else values[:, column]
    return parts, out
