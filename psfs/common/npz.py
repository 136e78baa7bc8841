"""Read npz files, and check their arrays."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cl import InputError
from psfs.common.ranges import LARGEST
from psfs.common.reading import open_input, parsing

#: Most bytes of all arrays of a file together.
_MOST_BYTES = 4 * 2**30


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


#: The codes of NumPy's types, and the name, of each kind.
_KINDS = {
    "float": ("fiu", "numbers"),
    "int": ("iu", "whole numbers"),
    "bool": ("biuf", "flags"),
    "text": ("U", "text"),
}


def read_npz(path: Path, schema: Mapping[str, Values], what: str) -> dict[str, np.ndarray]:
    """Read all arrays of an npz and check those that `schema` names.

    what: description of the expected file, for errors. Raises InputError, or MissingFileError if
    the file is absent.
    """
    with (
        parsing(path, what),
        open_input(path, what) as opened,
        zipfile.ZipFile(opened) as archive,
    ):
        total = sum(entry.file_size for entry in archive.infolist())
        if total > _MOST_BYTES:
            raise InputError(f"{path}: its arrays unpack to {total / 2**20:,.0f} MiB; expected "
                             f"{what}, of at most {_MOST_BYTES / 2**20:,.0f} MiB")  # fmt: skip
        data = {
            name.removesuffix(".npy"): np.lib.format.read_array(archive.open(name))
            for name in archive.namelist()
        }
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
    with parsing(path, what), open_input(path, what) as file:
        array = np.lib.format.read_array(file)
    check_values(path, "the array", array, values, {})
    return array


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
    codes, expected = _KINDS[values.kind]
    if array.dtype.kind not in codes:
        raise InputError(f"{where}: {key} is {array.dtype}; expected {expected}")
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
    for wanted, actual in zip(shape, array.shape, strict=False):
        length = wanted if isinstance(wanted, int) else lengths.setdefault(wanted, (actual, key))[0]
        fits = fits and actual == length
    if not fits:
        known = lengths if array.ndim == len(shape) else {}
        named = [str(n if isinstance(n, int) else known.get(n, (n, ""))[0]) for n in shape]
        raise InputError(
            f"{where}: {key} has the shape {array.shape}; expected ({', '.join(named)})"
        )


def get_scalar(array: object) -> Any:
    """Return the only element of an array."""
    return np.asarray(array).ravel()[0].item()
