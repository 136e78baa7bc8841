"""Reading TOML with errors that name the file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from cl import InputError
from psfs.common.files import unreadable

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


def read_toml(path: Path) -> dict[str, Any]:
    """Return the contents of a TOML file. Raises InputError if it is malformed, MissingFileError
    if it is absent."""
    try:
        return parse_toml(path.read_text(encoding="utf-8"), path)
    except OSError as error:
        raise unreadable(path, error) from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: cannot be read: not UTF-8 text") from None


def parse_toml(text: str, source: str | Path) -> dict[str, Any]:
    """Return the contents of `text`. Raises InputError naming its `source` if it is malformed."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{source}: malformed TOML: {' '.join(str(error).split())}") from None
