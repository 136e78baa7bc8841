"""Files of numbers, and files written whole: to a temporary name, then renamed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from cl import UserError


def read_numbers(path: Path) -> np.ndarray:
    """(N,) float64: the numbers of a text file, with white space between them. Raises UserError
    naming the file if it cannot be read or holds anything else."""
    try:
        return np.array(path.read_text().split(), np.float64)
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise UserError(f"{path}: expected numbers only: {error}") from None


@contextmanager
def written_whole(path: str | Path) -> Iterator[Path]:
    """A temporary path beside `path` (same suffix); renamed to `path` on success, else removed.

    `with written_whole("a.ply") as temporary: write(temporary)`
    Raises UserError if the file system refuses (no permission, disk full, a file for a folder).
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
        raise UserError(f"{path}: cannot be written: {error.strerror or error}") from error
