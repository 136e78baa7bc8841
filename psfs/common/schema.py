"""Validation of tables from files by pydantic models, with errors of one line."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
)

from cl import InputError
from psfs.common.ranges import LARGEST, SHOWN, check_name, escape_unprintable

T = TypeVar("T")


class Table(BaseModel):
    """A table of plain values: types are not converted, unknown keys are passed over."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False, frozen=True)


#: Numbers, finite. TOML and JSON write whole ones without a point.
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(gt=0, le=LARGEST)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]


def flat(*counts: int) -> BeforeValidator:
    """Return what makes plain lists, nested or not, one list of as many finite numbers as one of
    the `counts` says."""

    def flattened(value: object) -> list[float]:
        try:
            numbers = np.asarray(value if isinstance(value, list) else [None])
        except ValueError:  # lists of different lengths
            numbers = np.array([None])
        truths = [item for item in np.asarray(value, object).ravel() if isinstance(item, bool)]
        if truths or numbers.dtype.kind not in "iuf" or numbers.size not in counts:
            raise ValueError(f"{' or '.join(map(str, counts))} numbers")
        if not np.isfinite(numbers).all():
            raise ValueError("numbers that are finite")
        return [float(number) for number in numbers.ravel()]

    return BeforeValidator(flattened)


def _parse_name(name: str) -> str:
    try:
        return check_name(name, "it")
    except InputError as error:
        why = re.search(r"with '.+' in it|a name of \d+ characters", str(error))
        but = f", not {why.group()}" if why else ""
        raise ValueError(f"a name of letters, digits, - and _{but}") from None


#: A name that can be a file's, see `check_name`.
Name = Annotated[str, AfterValidator(_parse_name)]


def _path_text(value: object) -> str:
    if not isinstance(value, str) or "\0" in value:
        raise ValueError("a path")
    return value


def _absolute(path: str) -> str:
    if not re.match(r"/|[A-Za-z]:", path):
        raise ValueError("a path from the root")
    return path


#: A path, also one that is no UTF-8, which is no text for pydantic.
PathText = Annotated[Any, AfterValidator(_path_text)]
AbsolutePath = Annotated[PathText, AfterValidator(_absolute)]


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def parse_values(kind: type[T], values: object, where: Path | str = "") -> T:
    """Return `values` as `kind`, a model or any type pydantic knows. Raises InputError that names
    `where`, the key, what was found and what was expected."""
    try:
        parsed: T = _adapter(cast(Any, kind)).validate_python(values)
    except ValidationError as error:
        before = f"{where}: " if where else ""
        raise InputError(before + describe_error(error, values)) from None
    return parsed


def _key(place: tuple[int | str, ...], values: Any) -> str:
    """Return how to call the value at `place`: entries of lists by their names, if they have some,
    as in `cone head, radii.1`."""
    parts: list[str] = []
    for step in place:
        try:
            values = values[step]
        except (KeyError, IndexError, TypeError):  # one that is missing, or a kind of a union
            values = None
        name = values.get("name") if isinstance(values, dict) else None
        if isinstance(step, int) and isinstance(name, str) and parts:
            parts = [f"{' '.join(parts)} {name[:SHOWN]},"]
        else:
            parts.append(str(step))
    return ".".join(parts).replace(",.", ", ").rstrip(",")


def describe_error(error: ValidationError, values: object) -> str:
    """Return the first of the errors in `values` as a line, and how many more there are."""
    first, *more = error.errors(include_url=False)
    key = _key(first["loc"], values)
    if first["type"] == "missing":
        text = f"lacks the key {escape_unprintable(key)}"
    elif first["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        text = f"has the key {escape_unprintable(key)}, which is unknown"
    else:
        value = repr(first["input"])
        value = value if len(value) <= SHOWN else f"{value[:SHOWN]}..."
        wanted = first["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
        if first["type"] in ("too_short", "too_long"):  # List should have ... after validation
            wanted = wanted.partition(" should have ")[2].partition(" after ")[0]
        wanted = wanted.replace("a valid tuple", "a list")
        quoted = escape_unprintable(value)
        text = f"{escape_unprintable(key) or 'the content'} is {quoted}; expected {wanted}"
    return text + (f" (and {len(more)} more of its entries are wrong)" if more else "")
