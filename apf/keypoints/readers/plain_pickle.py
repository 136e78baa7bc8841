"""Read pickles of plain values: lists, tables, numbers and texts. Nothing that a file names is run
or imported, and nothing larger than the file is allocated."""

from __future__ import annotations

import io
import pickle
import pickletools
from pathlib import Path
from typing import NoReturn

from cl import InputError
from psfs.common.files import MOST_BYTES
from psfs.common.reading import open_input, parsing


class _Plain(pickle.Unpickler):
    """Python's reader of what `_check_sizes` let pass, without code."""

    def find_class(self, module: str, name: str) -> NoReturn:
        raise InputError(f"names code ({module} {name})"[:90] + ", which is never run")


def _check_sizes(data: bytes) -> None:
    """Raise ValueError where a pickle states more than it holds: the reader allocates values of
    stated lengths before it reads them, and a table of as many values as the largest number."""
    for operation, argument, _ in pickletools.genops(data):  # checks the lengths itself
        if operation.name in ("PUT", "BINPUT", "LONG_BINPUT") and int(argument or 0) > len(data):
            raise ValueError(f"value {argument:,} of a file of {len(data):,} bytes")


def read_plain_pickle(path: Path, what: str) -> object:
    """Read a pickle of plain values.

    what: description of the expected content, for errors. Raises InputError for a file that is
    damaged, too large, or names anything that is no plain value.
    """
    with parsing(path, what), open_input(path, what) as file:
        data = file.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise InputError(f"{path}: more than {MOST_BYTES // 2**20} MiB; expected {what}")
        try:
            _check_sizes(data)
            return _Plain(io.BytesIO(data)).load()
        except InputError as error:
            raise InputError(f"{path}: {error}; expected {what}") from None
