"""Read pickles of plain values: lists, tables, numbers and texts. Nothing that a file names is run
or imported, and nothing larger than the file is allocated."""

from __future__ import annotations

import io
import pickle
from pathlib import Path
from typing import ClassVar, NoReturn

from cl import InputError
from psfs.common.files import MOST_BYTES
from psfs.common.reading import open_input, parsing


class _Plain(pickle._Unpickler):
    """Python's own reader, whose table of values is no array that a file could make it allocate."""

    dispatch: ClassVar = {
        code: load
        for code, load in pickle._Unpickler.dispatch.items()
        if code != pickle.BYTEARRAY8[0]  # allocated before it is read
    }

    def find_class(self, module: str, name: str) -> NoReturn:
        raise InputError(f"names code ({module} {name})"[:90] + ", which is never run")


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
            return _Plain(io.BytesIO(data)).load()
        except InputError as error:
            raise InputError(f"{path}: {error}; expected {what}") from None
