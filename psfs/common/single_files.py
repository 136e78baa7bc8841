"""Single files that a command writes where the user says, such as `--png FILE`.

Inside `guard_files`, which every command runs in, an existing file is replaced only if a command
wrote it and nobody has changed it since, or if the user allows it with --overwrite. What commands
wrote is listed in the cache folder.
"""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from cl import InputError
from cl.folders import cache_folder, write_whole

#: Most files that are remembered.
_MOST_REMEMBERED = 1000
_LIST = "written.txt"


@dataclass
class _Guard:
    """State of the running command. active: whether existing files are protected. overwrite: what
    --overwrite says."""

    active: bool = False
    overwrite: bool = False


_guard = _Guard()


@contextlib.contextmanager
def guard_files(overwrite: bool = False) -> Iterator[None]:
    """Protect existing files inside; a command within a command keeps the outer one's rule."""
    if _guard.active:
        yield
        return
    _guard.active, _guard.overwrite = True, overwrite
    try:
        yield
    finally:
        _guard.active, _guard.overwrite = False, False


def check_file(path: Path, inputs: Iterable[Path] = ()) -> None:
    """Raise InputError if `path` must not be written.

    That is so if it is no regular file, if it lies in one of the folders `inputs`, which are read,
    or, inside `guard_files`, if it exists and is not a command's own.
    """
    real = Path(os.path.realpath(path.parent)) / path.name
    for folder in map(os.path.realpath, inputs):
        if folder in (str(real), str(real.parent)):
            raise InputError(f"{path}: lies among the files that are read; expected another folder")
    try:
        found = path.lstat()
    except OSError:  # absent; what else is wrong is reported when it is written
        return
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{path}: exists and is no regular file; expected a name for a new file")
    if not _guard.active or _guard.overwrite or _entry(real, found) in _read_list():
        return
    raise InputError(
        f"{path}: exists and was not written by this program; expected a name for a new file, or "
        "--overwrite"
    )


def remember_file(path: Path) -> None:
    """List `path`, which a command has written, so that the next one may replace it."""
    if not _guard.active:
        return
    with contextlib.suppress(OSError):  # then the next command asks for --overwrite
        real = Path(os.path.realpath(path))
        entries = [*_read_list(), _entry(real, real.lstat())][-_MOST_REMEMBERED:]
        write_whole(cache_folder() / _LIST, "".join(f"{entry}\n" for entry in entries))


def _entry(path: Path, found: os.stat_result) -> str:
    """Return the line of a file, which changes with its content."""
    return f"{found.st_size} {found.st_mtime_ns} {str(path)!r}"


def _read_list() -> list[str]:
    try:
        return (cache_folder() / _LIST).read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError):
        return []
