"""Write a folder of results completely or not at all, even if several processes write it or die."""

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
_PARTIAL = re.compile(r"(?<![^/\\\s'\"])\.([^/\\]+)\.partial-([^/\\]+)-(\d+)-[0-9a-f]{8}\b")

#: Suffix of the replaced folder while the new one is renamed.
_OLD = ".old"


@contextmanager
def replace_folder(path: Path) -> Iterator[Path]:
    """Yield a new folder beside `path`; rename it to `path` on success, else remove it.

    An existing folder is replaced, but files that its manifest does not name are kept; they raise
    an error if a new file has the same name. Leftovers of killed processes of this host are
    removed. Raises InputError if the file system refuses.
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
    """Link the files of the old folder that no command wrote into the new one."""
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
            old.rename(path)  # keep the old results rather than none
        raise
    shutil.rmtree(old, ignore_errors=True)


def replace_temporary_names(text: str) -> str:
    """Replace the names of temporary folders in a text by their final names."""
    return _PARTIAL.sub(r"\1", text)


def clear_partial(path: Path, of_all: bool = False) -> None:
    """Remove what killed processes of this host left of `path`.

    of_all: also what processes of other hosts and this one left, when nobody works on it any more.
    """
    if not path.parent.is_dir():
        return
    for folder in list(path.parent.iterdir()):
        found = _PARTIAL.fullmatch(folder.name.removesuffix(_OLD))
        if found is None or found[1] != path.name:
            continue
        if of_all or (found[2] == platform.node() and not is_alive(int(found[3]))):
            if folder.suffix == _OLD and not path.exists():  # killed between the two renames
                folder.rename(path)
            shutil.rmtree(folder, ignore_errors=True)
