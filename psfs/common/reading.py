"""Open input files, and convert every error of a parser into a message of one line.

Every reader opens its file by `open_input`, which neither waits for a pipe nor reads a device, and
parses it inside `parsing`.
"""

from __future__ import annotations

import logging
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from cl import InputError, MissingFileError, UserError

log = logging.getLogger(__name__)


def unreadable_error(path: Path, error: OSError, what: str = "") -> InputError:
    """Return the error to raise for a file that the file system cannot read; what: description of
    the expected file."""
    expected = f"; expected {what}" if what else ""
    if isinstance(error, FileNotFoundError):
        return MissingFileError(f"{path}: no such file{expected}")
    return InputError(f"{path}: cannot be read: {error.strerror or error}{expected}")


def open_input(path: Path, what: str = "") -> IO[bytes]:
    """Open a regular file, never waiting for the other end of a pipe.

    what: description of the expected file, for errors. Raises InputError for anything else than a
    regular file, MissingFileError if there is none.
    """
    try:
        file = open(path, "rb", opener=_open_at_once)  # noqa: SIM115  Path has no opener
    except OSError as error:
        raise unreadable_error(path, error, what) from None
    if stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        return file
    file.close()
    raise InputError(f"{path}: is no regular file; expected {what or 'a file'}")


def _open_at_once(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


@contextmanager
def parsing(path: Path | str, what: str) -> Iterator[None]:
    """Turn every error inside into InputError that names the file `path` and the expected `what`.

    A parser raises almost anything when it meets what it does not expect. Our own errors pass; a
    lack of memory is blamed on the file's size.
    """
    try:
        yield
    except UserError:
        raise
    except OSError as error:
        raise unreadable_error(Path(path), error, what) from None
    except MemoryError:
        raise InputError(f"{path}: too large for the memory; expected {what}") from None
    except Exception as error:
        log.info("%s", path, exc_info=True)
        deep = isinstance(error, RecursionError)
        reason = "nested too deeply" if deep else " ".join(str(error).split())[:200]
        cause = f" ({reason or type(error).__name__})"
        raise InputError(f"{path}: damaged or of another kind{cause}; expected {what}") from error
