"""Read pickles of plain values: lists, tables, numbers and texts. Nothing that a file names is run
or imported, and nothing larger than the file is allocated."""

from __future__ import annotations

import pickle
import pickletools
from pathlib import Path

from cl import InputError
from psfs.common.files import MOST_BYTES
from psfs.common.reading import open_input, parsing

#: The operations that make plain values.
_PLAIN = frozenset(
    (
        *("PROTO", "FRAME", "STOP", "MARK", "POP", "POP_MARK", "DUP", "NONE", "NEWTRUE"),
        *("NEWFALSE", "INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT"),
        *("BINFLOAT", "STRING", "BINSTRING", "SHORT_BINSTRING", "UNICODE", "BINUNICODE"),
        *("SHORT_BINUNICODE", "BINUNICODE8", "EMPTY_LIST", "LIST", "APPEND", "APPENDS"),
        *("EMPTY_TUPLE", "TUPLE", "TUPLE1", "TUPLE2", "TUPLE3", "EMPTY_DICT", "DICT"),
        *("SETITEM", "SETITEMS", "PUT", "BINPUT", "LONG_BINPUT", "MEMOIZE"),
        *("GET", "BINGET", "LONG_BINGET"),
    )
)
_STORING = ("PUT", "BINPUT", "LONG_BINPUT")


def read_plain_pickle(path: Path, what: str) -> object:
    """Read a pickle of plain values.

    what: description of the expected content, for errors. Raises InputError for a file that is
    damaged, too large, or makes anything else than lists, tuples, dictionaries, numbers and texts.
    """
    with parsing(path, what), open_input(path, what) as file:
        data = file.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise InputError(f"{path}: more than {MOST_BYTES // 2**20} MiB; expected {what}")
        _check_operations(path, data, what)
        return pickle.loads(data)


def _check_operations(path: Path, data: bytes, what: str) -> None:
    """Raise InputError for an operation that makes no plain value, or that stores a value under a
    number for which the reader would allocate more than the file's size."""
    text: object = ""
    for operation, value, _ in pickletools.genops(data):
        if operation.name not in _PLAIN:
            named = f"{text if value is None else value}"[:80]
            raise InputError(f"{path}: names code ({named}), which is never run; expected {what}")
        if operation.name in _STORING and isinstance(value, int) and value > len(data):
            raise InputError(f"{path}: damaged (value number {value:,}); expected {what}")
        if isinstance(value, str):
            text = value
