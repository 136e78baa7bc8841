"""Cache folders of this program, PoCL and PyOpenCL."""

from __future__ import annotations

import getpass
import logging
import os
import tempfile
import threading
from pathlib import Path

from platformdirs import user_cache_path

log = logging.getLogger(__name__)


def cache_folder() -> Path:
    """Return our folder in the user's cache; it may not exist yet."""
    replace_unwritable_caches()
    return user_cache_path("psfs-apf", appauthor=False)


def replace_unwritable_caches() -> None:
    """Move caches that cannot be written to a temporary folder: PoCL and PyOpenCL fail without a
    writable cache."""
    usual_folders = {"XDG_CACHE_HOME": "~/.cache", "POCL_CACHE_DIR": None}
    for variable, usual in usual_folders.items():
        folder = os.environ.get(variable) or usual
        if folder is not None and not _is_writable(folder):
            replacement = str(Path(tempfile.gettempdir()) / f"psfs-cache-{_user()}")
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
        with tempfile.TemporaryFile(dir=folder):
            return True
    except (OSError, RuntimeError):
        return False


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):  # a number without a name, as in containers
        return "user"
