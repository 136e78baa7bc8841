"""The folder that a sequence lies in."""

from __future__ import annotations

from pathlib import Path

from cl import InputError, MissingFileError


def check_folder(folder: Path, wanted: str = "expected a folder with calibrated views") -> None:
    """Raise MissingFileError if there is no such folder, InputError if it is a file."""
    if folder.is_dir():
        return
    if folder.exists():
        raise InputError(f"{folder}: a file; {wanted}")
    raise MissingFileError(f"{folder}: no such folder; {wanted}")
