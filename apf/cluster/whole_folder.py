"""A folder of results that is there whole, or not at all, however many work on it and die."""

from __future__ import annotations

import os
import platform
import re
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cl import InputError
from psfs.common.outputs import MANIFEST, Manifest
from psfs.common.system import is_alive

#: .NAME.partial-HOST-PID-ATTEMPT
_PARTIAL = re.compile(r"\.([^/]+)\.partial-([^/]+)-(\d+)-[0-9a-f]{8}\b")

#: Ends the name of what stood there before, while the new folder gets its name.
_OLD = ".old"


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Give a new folder beside `path`, which gets its name on success and else is removed.

    What stood at `path` is replaced, but for files that its manifest does not name: those are kept,
    and refused where they are in the way. Leftovers of processes of this host that were killed are
    cleared. Raises InputError if the file system refuses.
    """
    attempt = f"{platform.node()}-{os.getpid()}-{uuid.uuid4().hex[:8]}"
    partial = path.with_name(f".{path.name}.partial-{attempt}")
    try:
        clear_partial(path)
        partial.mkdir(parents=True)
        try:
            yield partial
            _link_foreign(path, partial)
            _replace(path, partial)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    except OSError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error


def _link_foreign(path: Path, partial: Path) -> None:
    """Give the new folder the files in the old one that no command wrote."""
    manifest = Manifest.read(path) if path.is_dir() else None
    ours = {MANIFEST, *(manifest.files if manifest is not None else ())}
    for file in path.rglob("*"):
        name = file.relative_to(path)
        if str(name) in ours or (file.is_dir() and not file.is_symlink()):
            continue
        if os.path.lexists(partial / name):
            raise InputError(
                f"{file}: is there already and not of an earlier run ({MANIFEST} does not name "
                "it); expected another output folder"
            )
        (partial / name).parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(file, partial / name, follow_symlinks=False)
        except OSError:  # a file system without links
            shutil.copy2(file, partial / name, follow_symlinks=False)


def _replace(path: Path, partial: Path) -> None:
    old = partial.with_name(f"{partial.name}{_OLD}")
    with suppress(FileNotFoundError):
        path.rename(old)
    try:
        partial.rename(path)
    except OSError:
        with suppress(OSError):
            old.rename(path)  # the older results rather than none
        raise
    shutil.rmtree(old, ignore_errors=True)


def final_names(text: str) -> str:
    """Return a text that names temporary folders with the names that they are to have."""
    return _PARTIAL.sub(r"\1", text)


def clear_partial(path: Path, of_all: bool = False) -> None:
    """Remove what killed processes of this host left of `path`; with `of_all` that of others and of
    this process too, for when nobody works on it any more."""
    if not path.parent.is_dir():
        return
    for folder in list(path.parent.iterdir()):
        found = _PARTIAL.fullmatch(folder.name.removesuffix(_OLD))
        if found is None or found[1] != path.name:
            continue
        if of_all or (found[2] == platform.node() and not is_alive(int(found[3]))):
            if folder.suffix == _OLD and not path.exists():  # killed between the two names
                folder.rename(path)
            shutil.rmtree(folder, ignore_errors=True)
