"""Files of numbers, and files written whole: to a temporary name, then renamed."""

from __future__ import annotations

import json
import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cl import InputError, MissingFileError


def unreadable(path: Path, error: OSError) -> InputError:
    """Return the error to raise for a file that the file system does not give."""
    kind = MissingFileError if isinstance(error, FileNotFoundError) else InputError
    return kind(f"{path}: cannot be read: {error.strerror}")


def read_numbers(path: Path) -> np.ndarray:
    """Return the numbers (N,) float64 of a text file, with white space between them. Raises
    InputError naming the file if it cannot be read or holds anything else, MissingFileError if it
    is absent."""
    try:
        return np.array(path.read_text().split(), np.float64)
    except OSError as error:
        raise unreadable(path, error) from None
    except ValueError as error:
        raise InputError(f"{path}: expected numbers only: {error}") from None


def read_npz(path: Path, keys: Sequence[str], what: str) -> dict[str, np.ndarray]:
    """Return all arrays of an npz that must hold `keys`; `what` says in errors what it should be.
    Raises InputError, or MissingFileError if the file is absent."""
    try:
        with np.load(path, allow_pickle=False) as file:
            data = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise MissingFileError(f"{path}: no such file; expected {what}") from None
    # A .npy loads as an array, which is no context manager with `files` (AttributeError).
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error, AttributeError,
            TypeError, KeyError, NotImplementedError):  # fmt: skip
        raise InputError(f"{path}: not a readable npz file; expected {what}") from None
    missing = [key for key in keys if key not in data]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}; expected {what}")
    return data


@contextmanager
def written_whole(path: str | Path) -> Iterator[Path]:
    """Give a temporary path beside `path` (same suffix); renamed to `path` on success, else
    removed.

    `with written_whole("a.ply") as temporary: write(temporary)`
    Raises InputError if the file system refuses (no permission, disk full, a file for a folder).
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield temporary
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write plain values. Raises InputError as `written_whole` does."""
    with written_whole(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n")


def write_picture(path: Path, picture: np.ndarray) -> None:
    """Write a BGR picture; the suffix of `path` says the format. Raises InputError if unknown."""
    with written_whole(path) as temporary:
        try:
            done = cv2.imwrite(str(temporary), picture)
        except cv2.error as error:
            wanted = "no picture format; expected a name such as view.png"
            raise InputError(f"{path}: {wanted}") from error
        if not done:
            raise InputError(f"{path}: the picture could not be written")
