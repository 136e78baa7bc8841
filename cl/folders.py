"""Cache folders of this program, PoCL and PyOpenCL."""

from __future__ import annotations

import atexit
import getpass
import logging
import os
import shutil
import stat
import tempfile
import threading
from contextlib import suppress
from pathlib import Path

from platformdirs import user_cache_path

from cl.errors import InputError

log = logging.getLogger(__name__)

#: Bytes of the largest file of a compiler.
_ROOM = 2**20


def cache_folder() -> Path:
    """Return our folder in the user's cache; it may not exist yet."""
    replace_unwritable_caches()
    return user_cache_path("psfs-apf", appauthor=False)


def replace_unwritable_caches() -> None:
    """Move caches that cannot be written to a temporary folder: PoCL and PyOpenCL fail without a
    writable cache. They run what lies there, so that nobody else may write to it. Raises InputError
    if no place has room for a kernel: the compiler would end the process."""
    usual_folders = {"XDG_CACHE_HOME": "~/.cache", "POCL_CACHE_DIR": None}
    for variable, usual in usual_folders.items():
        folder = os.environ.get(variable) or usual
        if folder is not None and not _is_writable(folder):
            replacement = _private_folder()
            if not _is_writable(replacement):
                raise InputError(
                    f"{replacement}: has no room for compiled kernels, nor has the cache {folder}; "
                    "expected a disk with space, and files of 1 MiB to be allowed (ulimit -f)"
                )
            log.warning("the cache %s cannot be written; %s is used", folder, replacement)
            os.environ[variable] = replacement


def write_whole(path: Path, text: str) -> None:
    """Write a text file in one step: other processes see the old file or the new one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f"{path.name}.{os.getpid()}.{threading.get_ident()}")
    try:
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _is_writable(place: str) -> bool:
    try:
        folder = Path(place).expanduser()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
            return file.write(bytes(_ROOM)) == _ROOM
    except (OSError, RuntimeError):
        return False


def _private_folder() -> str:
    """Return the temporary folder of this user's caches, or a new one if somebody else has made it
    or may write to it."""
    user = os.getuid() if hasattr(os, "getuid") else getpass.getuser()
    folder = Path(tempfile.gettempdir()) / f"psfs-cache-{user}"
    with suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        private = found.st_uid == user and not found.st_mode & 0o022
        if os.name == "nt" or (stat.S_ISDIR(found.st_mode) and private):
            return str(folder)
    new = tempfile.mkdtemp(prefix=f"psfs-cache-{user}-")
    atexit.register(shutil.rmtree, new, ignore_errors=True)
    return new
