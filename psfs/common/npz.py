"""Read npz files; what they claim is checked before anything is allocated."""

from __future__ import annotations

import math
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from cl import InputError, MissingFileError
from psfs.common.files import unreadable_error
from psfs.common.schema import LARGEST

#: Most bytes of all arrays of a file together.
MOST_BYTES = 4 * 2**30
_MOST_ARRAYS = 1000
_MOST_DIMENSIONS = 8
#: Most bytes of an array's header.
_MOST_HEADER = 10_000
_BROKEN = (ValueError, EOFError, zipfile.BadZipFile, zlib.error, TypeError, KeyError,
           NotImplementedError, RuntimeError, SyntaxError, RecursionError, OverflowError,
           struct.error)  # fmt: skip


@dataclass(frozen=True)
class Values:
    """The expected properties of an array.

    shape: for each dimension a number, or a letter that stands for the same length wherever it
    occurs; None for any shape. kind: "float" for any numbers, "int" for whole ones, "bool" for
    numbers as flags, "text". finite: no NaN or infinity, and no value beyond `LARGEST`; otherwise
    NaN means unknown, and infinity is still rejected. low, high: bounds, inclusive.
    """

    shape: tuple[int | str, ...] | None
    kind: str = "float"
    finite: bool = True
    low: float = -LARGEST
    high: float = LARGEST
    needed: bool = True


_KINDS = {"float": "fiu", "int": "iu", "bool": "biuf", "text": "U"}


def read_npz(path: Path, schema: Mapping[str, Values], what: str) -> dict[str, np.ndarray]:
    """Read all arrays of an npz and check those that `schema` names.

    what: description of the expected file, for errors. Raises InputError, or MissingFileError if
    the file is absent.
    """
    data = _load(path, what)
    missing = [key for key, values in schema.items() if values.needed and key not in data]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}; expected {what}")
    lengths: dict[str, tuple[int, str]] = {}
    for key, values in schema.items():
        if key in data:
            check_values(path, key, data[key], values, lengths)
    return data


def read_npy(path: Path, values: Values, what: str) -> np.ndarray:
    """Read and check the array of an npy file; what: description of the expected file, for errors.

    Raises InputError, or MissingFileError if the file is absent.
    """
    with _translate_errors(path, "npy", what), path.open("rb") as file:
        array = _read_array(path, "it", file, min(path.stat().st_size, MOST_BYTES))
    check_values(path, "the array", array, values, {})
    return array


def _load(path: Path, what: str) -> dict[str, np.ndarray]:
    with _translate_errors(path, "npz", what), zipfile.ZipFile(path) as archive:
        entries = archive.infolist()
        if len(entries) > _MOST_ARRAYS:
            raise InputError(f"{path}: holds {len(entries)} arrays; "
                             f"expected at most {_MOST_ARRAYS}")  # fmt: skip
        total, data = 0, {}
        for entry in entries:
            total += entry.file_size
            if total > MOST_BYTES:
                raise InputError(f"{path}: its arrays take more than "
                                 f"{MOST_BYTES / 2**30:.0f} GiB; expected {what}")  # fmt: skip
            name = entry.filename.removesuffix(".npy")
            with archive.open(entry) as file:
                data[name] = _read_array(path, name, file, entry.file_size)
        return data


@contextmanager
def _translate_errors(path: Path, kind: str, what: str) -> Iterator[None]:
    """Turn the errors of reading an npz or npy file (`kind`) into InputError or
    MissingFileError."""
    try:
        yield
    except FileNotFoundError:
        raise MissingFileError(f"{path}: no such file; expected {what}") from None
    except OSError as error:
        raise unreadable_error(path, error) from None
    except InputError:
        raise
    except _BROKEN:
        raise InputError(f"{path}: not a readable {kind} file; expected {what}") from None


def _read_array(path: Path, name: str, file: IO[bytes], nbytes: int) -> np.ndarray:
    """Read one array, whose header must agree with the `nbytes` of its entry."""
    version = np.lib.format.read_magic(file)
    headers = {(1, 0): np.lib.format.read_array_header_1_0,
               (2, 0): np.lib.format.read_array_header_2_0}  # fmt: skip
    shape, fortran, dtype = headers[version](file, max_header_size=_MOST_HEADER)
    if dtype.hasobject or dtype.fields is not None or len(shape) > _MOST_DIMENSIONS:
        raise InputError(f"{path}: {name} is an array of {dtype} with {len(shape)} dimensions; "
                         "expected plain numbers or text")  # fmt: skip
    if any(n < 0 for n in shape):
        raise InputError(f"{path}: {name} claims the shape {shape}; expected lengths from 0 on")
    claimed = math.prod(shape) * dtype.itemsize
    if claimed > nbytes:
        raise InputError(f"{path}: {name} claims {shape} of {dtype}, {claimed:,} bytes, but has "
                         f"{nbytes:,}; the file is damaged")  # fmt: skip
    content = file.read(claimed)
    if len(content) < claimed:
        raise InputError(f"{path}: {name} ends early; the file is damaged")
    flat = np.frombuffer(bytearray(content), dtype)
    return flat.reshape(shape[::-1]).T if fortran else flat.reshape(shape)


def check_values(
    where: Path | str,
    key: str,
    array: np.ndarray,
    values: Values,
    lengths: dict[str, tuple[int, str]],
) -> None:
    """Raise InputError unless `array` is as `values` require.

    lengths: length of each letter so far, and the key that it comes from.
    """
    if array.dtype.kind not in _KINDS[values.kind]:
        raise InputError(f"{where}: {key} is {array.dtype}; expected {_describe_kind(values)}")
    if values.shape is not None:
        _check_shape(where, key, array, values.shape, lengths)
    if values.kind == "text" or not array.size:
        return
    numbers = array if array.dtype.kind in "iub" else array[~np.isnan(array)]
    if values.finite and numbers.size < array.size:
        raise InputError(f"{where}: {key} holds NaN; expected finite numbers")
    outside = (numbers < values.low) | (numbers > values.high)
    if outside.any():
        raise InputError(f"{where}: {key} holds {numbers[outside].ravel()[0]:g}; expected numbers "
                         f"from {values.low:g} to {values.high:g}")  # fmt: skip


def _check_shape(
    where: Path | str,
    key: str,
    array: np.ndarray,
    shape: tuple[int | str, ...],
    lengths: dict[str, tuple[int, str]],
) -> None:
    fits = array.ndim == len(shape)
    for wanted, found in zip(shape, array.shape, strict=False):
        length = wanted if isinstance(wanted, int) else lengths.setdefault(wanted, (found, key))[0]
        fits = fits and found == length
    if not fits:
        named = [str(n if isinstance(n, int) else lengths.get(n, (n, ""))[0]) for n in shape]
        raise InputError(
            f"{where}: {key} has the shape {array.shape}; expected ({', '.join(named)})"
        )


def _describe_kind(values: Values) -> str:
    return {"float": "numbers", "int": "whole numbers", "bool": "flags", "text": "text"}[
        values.kind
    ]


def get_scalar(array: Any) -> Any:
    """Return the only element of an array."""
    return np.asarray(array).ravel()[0].item()
