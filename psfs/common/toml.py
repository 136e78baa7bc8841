"""Read TOML with errors that name the file, and write it."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from cl import InputError
from psfs.common.files import read_text, write_text

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

#: Largest file of settings, of a body or a calibration; one of 64 cameras takes less than 100 kB.
MOST_BYTES = 4 * 2**20


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file. Raises InputError if it is malformed, MissingFileError if it is absent."""
    return parse_toml(read_text(path, "TOML", MOST_BYTES), path)


def write_toml(path: Path, values: Mapping[str, object]) -> None:
    """Write plain values. Raises InputError as `write_atomically` does."""
    write_text(path, tomli_w.dumps(values))


def parse_toml(text: str, source: str | Path) -> dict[str, object]:
    """Parse TOML `text`. Raises InputError naming its `source` if it is malformed."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{source}: malformed TOML: nested too deeply") from None
    except ValueError as error:  # malformed TOML, or numbers with too many digits
        raise InputError(f"{source}: malformed TOML: {' '.join(str(error).split())}") from None
