"""Read and write files of text, TOML and JSON. They are written atomically: under a temporary name,
then renamed."""

from __future__ import annotations

import errno
import json
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TextIO
from xml.etree import ElementTree

import tomli_w

from cl import InputError, MissingFileError
from psfs.common.outputs import check_file, claim, remember_file, temporary_name
from psfs.common.reading import open_input, parsing, unreadable_error

if TYPE_CHECKING:
    import numpy as np

#: Largest file of a series: results of 100,000 frames take 10 MB as JSON, a minute of a camera's
#: keypoints with hands and face 20 MB.
MOST_BYTES = 256 * 2**20


def resolve_path(path: str | Path) -> Path:
    """Return the absolute path with symbolic links resolved as far as they exist. Raises InputError
    for a text that cannot be a path."""
    if "\0" in str(path):
        raise InputError(f"{str(path)!r}: holds the character NUL; expected a path")
    return Path(os.path.realpath(path))


def check_folder(folder: Path, wanted: str = "expected a folder with calibrated views") -> None:
    """Raise MissingFileError if there is no such folder, InputError if it is a file."""
    if folder.is_dir():
        return
    if folder.exists():
        raise InputError(f"{folder}: a file; {wanted}")
    raise MissingFileError(f"{folder}: no such folder; {wanted}")


@contextmanager
def name_file_in_errors(path: Path | str) -> Iterator[None]:
    """Put the file's name, or what else they are about, before the text of every InputError raised
    inside that does not begin with it; keep its class."""
    try:
        yield
    except InputError as error:
        if str(error).startswith(f"{path}: "):
            raise
        raise type(error)(f"{path}: {error}") from None


def read_numbers(path: Path) -> np.ndarray:
    """Read the numbers (N,) float64, separated by white space, of a text file with # comments.

    Raises InputError naming the file if it cannot be read or holds anything else, MissingFileError
    if it is absent.
    """
    import numpy as np

    lines = read_text(path, "numbers").splitlines()
    try:
        return np.array(" ".join(line.partition("#")[0] for line in lines).split(), np.float64)
    except ValueError as error:
        word = str(error).partition(": ")[2]
        quoted = word if len(word) <= 40 else f"{word[:40]}...'"
        raise InputError(f"{path}: expected numbers only; found {quoted}") from None


def read_json(path: Path, what: str, nan: bool = False) -> Any:
    """Read a JSON file of at most `MOST_BYTES`. Raises InputError, or MissingFileError if the file
    is absent.

    what: description of the expected file, for errors. nan: allow NaN and Infinity, which JSON does
    not have.
    """
    text = read_text(path, what, MOST_BYTES)
    try:
        return json.loads(text, parse_constant=None if nan else _reject_constant)
    except (ValueError, RecursionError) as error:
        reason = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise InputError(f"{path}: malformed JSON: {reason}; expected {what}") from None


def _reject_constant(name: str) -> float:
    raise ValueError(f"{name} is not a JSON number")


def read_text(path: Path, what: str, most_bytes: int = 16 * 2**20, encoding: str = "UTF-8") -> str:
    """Read a text file of at most `most_bytes`.

    what: description of the expected file, for errors. Raises InputError, or MissingFileError if
    the file is absent.
    """
    with parsing(path, what), open_input(path, what) as file:
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise InputError(f"{path}: more than {most_bytes // 2**20} MiB; expected {what}")
    try:
        return content.decode(encoding).removeprefix("\ufeff")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file ({encoding}); expected {what}") from None


@contextmanager
def write_atomically(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` (same suffix); rename it to `path` on success, else
    remove it.

    `with write_atomically("a.ply") as temporary: write(temporary)` In an output folder that is
    being written, see `psfs.common.outputs`, the name is added to its manifest. Raises InputError
    if the file system refuses (no permission, disk full, a file for a folder), or if there is a
    file of that name that no command of ours wrote; see `psfs.common.outputs` for those
    elsewhere.
    """
    path = Path(path)
    temporary = temporary_name(path)
    try:
        claimed = claim(path)
        if not claimed:
            check_file(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield temporary
            temporary.replace(path)
            if not claimed:
                remember_file(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise _unwritten_error(path, temporary, error) from error


def _unwritten_error(path: Path, temporary: Path, error: OSError) -> InputError:
    """Return the error for a file that was not written, or for another one that was to be copied
    into it."""
    named = Path(os.fsdecode(error.filename)) if isinstance(error.filename, str | bytes) else path
    if named in path.parents and isinstance(error, FileExistsError | NotADirectoryError):
        return InputError(f"{path}: cannot be written: {named} is a file; expected a folder")
    full = error.errno in (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)  # never of what is read
    if named not in (path, temporary, *path.parents) and not full:
        return unreadable_error(named, error)
    return InputError(f"{path}: cannot be written: {error.strerror or error}")


@contextmanager
def open_text(path: str | Path) -> Iterator[TextIO]:
    """Yield a text file (UTF-8, lines end with LF) that gets its name on success. What is no UTF-8,
    as names may be, is escaped. Raises InputError as `write_atomically` does."""
    with (
        write_atomically(path) as temporary,
        temporary.open("w", encoding="utf-8", newline="", errors="backslashreplace") as file,
    ):
        yield file


def write_text(path: str | Path, text: str) -> None:
    """Write a text file like `open_text`."""
    with open_text(path) as file:
        file.write(text)


def write_json(path: Path, content: Mapping[str, object]) -> None:
    """Write plain values as JSON. Raises InputError as `write_atomically` does."""
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def check_picture_name(path: Path, inputs: Iterable[Path]) -> None:
    """Raise InputError if `path` cannot be written by `write_picture`, or lies in one of the
    folders `inputs`, which are read."""
    import cv2  # takes a while to load

    check_file(path, inputs)
    # OpenCV crashes on text that is not UTF-8
    if not path.suffix.isascii() or not cv2.haveImageWriter(f"picture{path.suffix}"):
        raise _picture_format_error(path)


def write_picture(path: Path, picture: np.ndarray) -> None:
    """Write a BGR picture in the format of the suffix. Raises InputError if that is unknown."""
    import cv2  # takes a while to load

    try:
        done, content = cv2.imencode(path.suffix if path.suffix.isascii() else "", picture)
    except cv2.error:
        done = False
    if not done:
        raise _picture_format_error(path)
    with write_atomically(path) as temporary:
        temporary.write_bytes(content.tobytes())  # its errors say why


def _picture_format_error(path: Path) -> InputError:
    return InputError(f"{path}: unknown picture format; expected a name such as view.png")


def parse_xml(text: str, what: str) -> ElementTree.Element:
    """Return the root of an XML document; what: description of the expected file. Raises InputError
    without the file's name, also for a document type, whose entities may grow without bound."""
    if "<!" in text.replace("<!--", "").replace("<![CDATA[", ""):
        raise InputError(f"holds a document type; expected {what}, without one")
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"{error}; expected {what}") from None


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Yield a new temporary folder, which is removed afterwards."""
    with TemporaryDirectory(prefix="psfs-apf-") as folder:
        yield Path(folder)


if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

#: Largest file of settings, of a body or a calibration; one of 64 cameras takes less than 100 kB.
MOST_TOML_BYTES = 4 * 2**20


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file. Raises InputError if it is malformed, MissingFileError if it is absent."""
    return parse_toml(read_text(path, "TOML", MOST_TOML_BYTES), path)


def write_toml(path: Path, values: Mapping[str, object]) -> None:
    """Write plain values. Raises InputError as `write_atomically` does."""
    write_text(path, tomli_w.dumps(values))


def parse_toml(text: str, source: str | Path) -> dict[str, object]:
    """Parse TOML `text`. Raises InputError naming its `source` if it is malformed."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{source}: malformed TOML: nested too deeply") from None
    except ValueError as error:  # malformed TOML, or numbers with too many digits
        raise InputError(f"{source}: malformed TOML: {' '.join(str(error).split())}") from None
