"""Folders that commands write: only their own files are replaced, and complete runs are marked.

A command owns its folder from its first moment to its end by a lock; another one is refused. The
folder's `manifest.txt` names every file before it is written. When a run has its first result to
write, it removes the files that the manifest names; at its end it marks itself complete. Files that
the manifest does not name belong to the user and stay.
"""

from __future__ import annotations

import contextlib
import mimetypes
import os
import platform
import re
import shutil
import stat
import threading
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from cl import InputError, MissingFileError
from cl.folders import cache_folder, write_whole
from psfs.common.reading import open_input, parsing
from psfs.common.system import is_alive, lock_file

MANIFEST = "manifest.txt"
#: Time between two writes of what a run has done so far, s.
PART_SECONDS = 1.0
_HEAD = "psfs-apf manifest: these files were written by commands, which may replace them"
#: Prefix of the names of incomplete files; the process id follows.
_TEMPORARY = ".psfs-"
_LEFTOVER = re.compile(r"\.psfs-(\d+)-.+", re.DOTALL)
#: The file that is locked; it says who owns the folder.
_OWNER = ".psfs-owner"
#: Who makes footage: no command, or one of these.
_FILMED = ("nobody", "apf synth", "psfs convert")
#: Folders that are being written, by their full paths; `claim` looks them up.
_OPEN: dict[Path, OutputFolder] = {}
_lock = threading.RLock()


def temporary_name(path: Path) -> Path:
    """Return the temporary name beside `path`, with the same suffix. Raises InputError for the root
    folder."""
    if not path.name:
        raise InputError(f"{path}: has no name of its own; expected a folder inside it")
    return path.with_name(f"{_TEMPORARY}{os.getpid()}-{path.name}")


def clear_leftovers(folder: Path) -> None:
    """Remove the temporary files that killed processes left in `folder`."""
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            match = _LEFTOVER.fullmatch(path.name)
            if match and not is_alive(int(match[1])):
                if path.is_dir() and not path.is_symlink():
                    shutil.rmtree(path)
                else:
                    path.unlink(missing_ok=True)


@dataclass(frozen=True)
class Manifest:
    """The files of an output folder, and whether the last run finished.

    files: relative paths, each with the command that wrote it. command: of the run. whole: whether
    it finished.
    """

    files: dict[str, str] = field(default_factory=dict)
    command: str = ""
    whole: bool = True

    @classmethod
    def read(cls, folder: Path) -> Manifest:
        """Read the manifest of `folder`, an empty one if there is none.

        Raises InputError if it is another program's or cannot be read.
        """
        path = folder / MANIFEST
        try:
            with parsing(path, "a manifest"), open_input(path) as file:
                lines = file.read(2**28).split(b"\n")
        except MissingFileError:
            return cls()
        if len(lines) == 1 and _HEAD.encode().startswith(lines[0]):  # left by a killed process
            return cls()
        if lines[0] != _HEAD.encode():
            raise InputError(f"{path}: not a manifest of psfs-apf; expected another output folder")
        files: dict[str, str] = {}
        run = writer = ""
        whole = True
        for line in map(os.fsdecode, lines[1:-1]):  # the last line may be cut
            kind, _, rest = line.partition(" ")
            if kind in ("run", "also"):
                writer = rest
                if kind == "run":
                    run, whole = rest, False
            elif kind == "file" and _is_inside(rest):
                files[rest] = writer
            elif kind == "whole" and rest == run:
                whole = True
        return cls(files, run, whole)


def _is_inside(name: str) -> bool:
    path = Path(name)
    return bool(name) and "\0" not in name and not path.is_absolute() and ".." not in path.parts


def find_unfinished_command(folder: Path) -> str | None:
    """Return the command that did not finish writing `folder`, None if all is complete."""
    manifest = Manifest.read(folder)
    return None if manifest.whole else manifest.command


class OutputFolder:
    """A folder while a command writes to it; made by `output_folder`."""

    def __init__(
        self, folder: Path, command: str, addition: bool, replaces: bool, part: str = "."
    ) -> None:
        self.folder, self.command = folder, command
        self._addition, self._replaces, self._part = addition, replaces, part
        self._real = Path(os.path.realpath(folder))
        self._file: IO[bytes] | None = None
        self._owner: IO[bytes] | None = None
        self._new_folders: list[Path] = []
        self._names: set[str] = set()

    @property
    def begun(self) -> bool:
        """Whether anything was written."""
        return self._file is not None

    def claim(self, path: Path) -> None:
        """Enter `path`, which lies in this folder, in the manifest.

        The first call removes the files of the earlier run. Raises InputError for a file that the
        manifest does not name.
        """
        with _lock:
            name = os.path.relpath(path, self._real)
            if self._file is None and name != MANIFEST and os.path.lexists(path):
                ours = Manifest.read(self.folder).files
                if name not in ours:  # before anything is removed
                    raise _foreign_file_error(self.folder / name)
            self.begin()
            if name in self._names or name == MANIFEST:
                return
            if "\n" in name or not _is_inside(name):
                raise InputError(f"{path}: not a name for a result; expected one inside the folder")
            if os.path.lexists(path):
                raise _foreign_file_error(self.folder / name)
            self._append(f"file {name}")
            self._names.add(name)

    def finish(self) -> None:
        """Mark the run as complete."""
        if self._file is not None and not self._addition:
            self._append(f"whole {self.command}")

    def own(self) -> None:
        """Lock the folder, which is made if it is absent. Raises InputError that names the command
        that owns it."""
        self._new_folders = [p for p in (self._real, *self._real.parents) if not p.exists()]
        path = self._real / _OWNER
        try:
            self._real.mkdir(parents=True, exist_ok=True)
            while True:
                self._owner = path.open("a+b")
                self._lock_or_fail(self._owner)
                with contextlib.suppress(FileNotFoundError):  # its owner has just ended
                    if os.path.samestat(os.fstat(self._owner.fileno()), path.stat()):
                        break
                self._owner.close()
            owner = f"`{self.command}` (process {os.getpid()} on {platform.node()})"
            self._owner.truncate(0)
            self._owner.write(os.fsencode(owner))
            self._owner.flush()
        except OSError as error:
            self.close()
            raise InputError(f"{self.folder}: cannot be written: {error.strerror}") from None

    def close(self) -> None:
        """Unlock the folder; remove it if it is new and nothing was written."""
        if self._file is not None:
            self._file.close()
        if self._owner is not None:
            with contextlib.suppress(OSError):  # Windows removes no open file
                (self._real / _OWNER).unlink()
            self._owner.close()
            self._owner = None
        for folder in self._new_folders:
            with contextlib.suppress(OSError):  # it holds results
                folder.rmdir()

    def begin(self) -> None:
        """Remove the files of the earlier run and mark the run as incomplete, unless that is
        done."""
        with _lock:
            if self._file is None:
                self._begin()

    def check_inputs(self, inputs: Iterable[Path]) -> None:
        """Raise InputError if one of the input files and folders lies in this folder."""
        for path in inputs:
            source = Path(os.path.realpath(path))
            if source == self._real or self._real in source.parents:
                raise InputError(
                    f"{self.folder}: holds {path}, which is read; expected another folder"
                )

    def check(self, expected: Iterable[str]) -> None:
        """Raise InputError if results cannot be written here.

        A file that matches one of the `expected` patterns (of Path.glob) may exist that the
        manifest does not name, or the folder may hold footage: results among its pictures would be
        taken for cameras.
        """
        manifest = Manifest.read(self.folder)
        ours = manifest.files
        self._check_footage(ours)
        before = "" if self._addition else manifest.command
        if before and before != self.command:
            raise InputError(
                f"{self.folder}: holds what `{before}` wrote, which this command would replace; "
                "expected another folder"
            )
        for pattern in expected:
            inside = self._real / Path(pattern).parts[0]
            if len(Path(pattern).parts) > 1 and inside.exists() and not inside.is_dir():
                raise _foreign_file_error(self.folder / inside.name)
            for path in self._real.glob(pattern):
                if path.name != MANIFEST and os.path.relpath(path, self._real) not in ours:
                    raise _foreign_file_error(self.folder / os.path.relpath(path, self._real))

    def _check_footage(self, ours: Mapping[str, str]) -> None:
        """Raise InputError if the folder holds pictures or videos of a take. ours: the files that
        the manifest names, with their commands."""
        here = self._real / self._part
        for path in here.iterdir() if here.is_dir() else ():
            writer = ours.get(os.path.relpath(path, self._real), "" if ours else "nobody")
            kind = mimetypes.guess_type(path.name)[0] or ""
            footage = kind.startswith(("image/", "video/"))
            if writer in _FILMED and writer != self.command and footage:
                raise InputError(
                    f"{self.folder / self._part}: holds {path.name}, which may be read; expected "
                    "another folder than that of footage"
                )

    def _begin(self) -> None:
        manifest = Manifest.read(self.folder)  # raises an error for another program's
        before = manifest.files
        try:
            clear_leftovers(self._real)
            if self._addition:
                self._file = (self._real / MANIFEST).open("ab")
                if manifest == Manifest():
                    # left by a process that was killed while writing the head
                    self._file.truncate(0)
                    self._append(_HEAD)
                self._append(f"also {self.command}")
                if self._replaces:
                    self._remove(
                        name
                        for name, by in before.items()
                        if by == self.command and self._part in map(str, Path(name).parents)
                    )
            else:
                self._file = self._replace_manifest(before)  # incomplete before anything is removed
                self._remove(before)
            self._names = {name for name in before if os.path.lexists(self._real / name)}
            if not self._addition:
                self._file = self._replace_manifest(self._names)
        except OSError as error:
            raise InputError(f"{self.folder}: cannot be written: {error.strerror}") from None

    def _replace_manifest(self, names: Iterable[str]) -> IO[bytes]:
        """Replace the manifest by that of a run with these files, and return it."""
        temporary = temporary_name(self._real / MANIFEST)
        lines = [_HEAD, f"run {self.command}", *(f"file {name}" for name in sorted(names))]
        file = temporary.open("wb")
        file.write(b"".join(os.fsencode(line) + b"\n" for line in lines))
        file.flush()
        temporary.replace(self._real / MANIFEST)
        if self._file is not None:
            self._file.close()
        return file

    def _remove(self, names: Iterable[str]) -> None:
        folders = set()
        for name in names:
            path = self._real / name
            parent = Path(os.path.realpath(path.parent))
            if parent == self._real or self._real in parent.parents:  # no link leads elsewhere
                with contextlib.suppress(IsADirectoryError):
                    path.unlink(missing_ok=True)
                if parent != self._real:
                    folders.add(parent)
        for folder in sorted(folders, key=lambda path: -len(path.parts)):
            clear_leftovers(folder)
            with contextlib.suppress(OSError):  # it holds other files
                folder.rmdir()

    def _append(self, line: str) -> None:
        assert self._file is not None
        try:
            self._file.write(os.fsencode(line) + b"\n")
            self._file.flush()
        except OSError as error:
            raise InputError(
                f"{self.folder / MANIFEST}: cannot be written: {error.strerror}"
            ) from None

    def _lock_or_fail(self, file: IO[bytes]) -> None:
        try:
            lock_file(file)
        except BlockingIOError:
            file.seek(0)
            owner = os.fsdecode(file.read(200)) or "another process"
            raise InputError(
                f"{self.folder}: {owner} is writing to it; expected another folder"
            ) from None
        except OSError:  # a file system without locks
            return


def _foreign_file_error(path: Path) -> InputError:
    return InputError(
        f"{path}: is there already and not of an earlier run ({MANIFEST} does not name it); "
        "expected another output folder"
    )


@contextlib.contextmanager
def output_folder(
    folder: str | Path,
    command: str,
    inputs: Iterable[Path] = (),
    expected: Iterable[str] = (),
    addition: bool = False,
    replaces: bool = False,
) -> Iterator[OutputFolder]:
    """Open `folder` for results written by `write_atomically`; nothing changes before the first.

    command: the writer. inputs: files and folders that are read, none of which may lie in `folder`.
    expected: patterns of the results' names, which other files must not have. addition: add the
    files to those of an existing run instead of replacing it, whose manifest may lie above, as that
    of several people lies above the folder of one. replaces: then replace those that the same
    command wrote in `folder`. Raises InputError for a folder that cannot be written.
    """
    folder, part = Path(folder), "."
    check_place(folder)
    real = Path(os.path.realpath(folder))
    if addition and (owner := _find_owner(real)) != real:
        part = os.path.relpath(real, owner)
        folder, real, expected = owner, owner, [str(Path(part, name)) for name in expected]
    with _lock:
        outer = _OPEN.get(real)
    if outer is not None:  # a command within a command
        if not outer.begun:
            outer.check(expected)
        yield outer
        return
    output = OutputFolder(folder, command, addition, replaces, part)
    output.check_inputs(inputs)
    output.own()
    try:
        output.check(expected)
        with _lock:
            _OPEN[real] = output
        yield output
        output.finish()
    finally:
        with _lock:
            _OPEN.pop(real, None)
            output.close()


def _find_owner(folder: Path) -> Path:
    """Return the folder whose manifest names files in `folder`: itself, or one of the two above it
    (seeds in the folders of people). Return `folder` if there is none."""
    for owner in (folder, *folder.parents[:2]):
        with contextlib.suppress(InputError):  # of another program
            if any(folder in (owner / name).parents for name in Manifest.read(owner).files):
                return owner
    return folder


def check_place(folder: Path) -> None:
    """Raise InputError if `folder` is a file or cannot be made."""
    try:
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{folder}: is a file; expected a folder, or a name for a new one")
        real = Path(os.path.realpath(folder))
        above = real
        while not above.exists():
            above = above.parent
        if not above.is_dir():
            raise InputError(f"{folder}: cannot be written: {above} is a file; expected a folder")
        if not os.access(above, os.W_OK | os.X_OK):
            raise InputError(f"{folder}: cannot be written: no permission for {above}")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None


def claim(path: Path) -> bool:
    """Enter `path` in the manifest of the output folder that it lies in, if that is being written;
    return whether it is.

    Raises InputError for a file that the manifest does not name, and for one that a symbolic link
    takes out of the folder.
    """
    real = Path(os.path.realpath(path.parent)) / path.name
    named = path.absolute()
    with _lock:
        for parent in real.parents:
            if parent in _OPEN:
                _OPEN[parent].claim(real)
                return True
        for output in _OPEN.values():
            if output.folder.absolute() in named.parents:
                raise InputError(
                    f"{path}: a symbolic link leads out of {output.folder}; expected a folder of "
                    "its own"
                )
    return False


#: Most files that are remembered.
_MOST_REMEMBERED = 1000
_LIST = "written.txt"


#: What --overwrite says; None unless existing files are protected.
_overwrite: bool | None = None


@contextlib.contextmanager
def guard_files(overwrite: bool = False) -> Iterator[None]:
    """Protect existing files inside; a command within a command keeps the outer one's rule."""
    global _overwrite
    if _overwrite is not None:
        yield
        return
    _overwrite = overwrite
    try:
        yield
    finally:
        _overwrite = None


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
        status = path.lstat()
    except OSError:  # absent; what else is wrong is reported when it is written
        return
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: exists and is no regular file; expected a name for a new file")
    if _overwrite is not False or _entry(real, status) in _read_list():
        return
    raise InputError(
        f"{path}: exists and was not written by this program; expected a name for a new file, or "
        "--overwrite"
    )


def remember_file(path: Path) -> None:
    """List `path`, which a command has written, so that the next one may replace it."""
    if _overwrite is None:
        return
    with contextlib.suppress(OSError):  # then the next command asks for --overwrite
        real = Path(os.path.realpath(path))
        entries = [*_read_list(), _entry(real, real.lstat())][-_MOST_REMEMBERED:]
        write_whole(cache_folder() / _LIST, "".join(f"{entry}\n" for entry in entries))


def _entry(path: Path, status: os.stat_result) -> str:
    """Return the line of a file, which changes with its content."""
    return f"{status.st_size} {status.st_mtime_ns} {str(path)!r}"


def _read_list() -> list[str]:
    try:
        return (cache_folder() / _LIST).read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError):
        return []
