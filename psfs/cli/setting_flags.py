"""Command-line flags that are derived from the settings whose fields name a flag.

Commands declare by `add_argument` only what is no setting: files, folders, frames, targets of a
calibration, devices, and what is written or printed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any

from pydantic.fields import FieldInfo

from cl import InputError
from psfs.common.config import (
    C,
    Config,
    SettingError,
    about,
    field_choices,
    field_kinds,
    fields_below,
)

Names = tuple[str, ...]


def find_flagged_settings(kind: type[Config]) -> Iterator[tuple[Names, FieldInfo]]:
    """Yield the settings with a flag of a class and its parts, each with the path of names that
    leads to it; the last name is the flag's destination."""
    for path, field in fields_below(kind):
        if about(field, "flag"):
            yield path, field


def usual_value(path: Names, field: FieldInfo) -> str:
    """Return the text for --help about the value without the flag: the default, or its source if
    the default is None."""
    default = field.default
    if default is None:
        return about(field, "source")
    return f"{default:g}" if isinstance(default, float) else str(default)


def add_setting_flags(
    group: Any,
    kind: type[Config],
    default: Callable[[Names, FieldInfo], str] = usual_value,
    *,
    only: Collection[str] = (),
    without: Collection[str] = (),
    parsers: Mapping[str, Callable[[str], Any]] | None = None,
    fill: bool = False,
) -> None:
    """Add the flags of a class of settings and its parts to a parser or a group; a flag that
    several settings share is added once.

    default: text for --help about the value without the flag. only, without: names of the settings.
    parsers: argparse types by setting, of those whose flags take more than a number, a text or a
    choice. fill: give the flags the settings' defaults, so that they are written beside results.
    """
    added = set()
    for path, field in find_flagged_settings(kind):
        name, flag = path[-1], about(field, "flag")
        if flag in added or name in without or (only and name not in only):
            continue
        added.add(flag)
        what = about(field, "flag_help") or _describe(field)
        group.add_argument(
            flag,
            dest=name,
            default=field.default if fill else None,
            help=f"{what} (default: {default(path, field)})".replace("%", "%%"),
            **_parsing(field, (parsers or {}).get(name)),
        )


def _parsing(field: FieldInfo, parser: Callable[[str], Any] | None) -> dict[str, object]:
    """Return how argparse parses the text of a setting's flag, and how --help names its value."""
    first, *_ = field_kinds(field)
    if first is bool:
        return {"action": "store_true"}
    choices = field_choices(field)
    if choices and parser is None:
        return {"choices": choices}
    kind = parser or (first if first in (int, float) else str)
    return {"type": kind, "metavar": about(field, "metavar") or None}


def with_flags(config: C, args: argparse.Namespace, without: tuple[str, ...] = ()) -> C:
    """Return the settings with the values that flags state, except those below the parts in
    `without`. Raises InputError that names the flag."""
    values: dict[str, Any] = {}
    names: dict[str, str] = {}
    for path, field in find_flagged_settings(type(config)):
        value = getattr(args, path[-1], None)
        dotted = ".".join(path)
        if value is None or dotted.startswith(without):
            continue
        names[dotted] = about(field, "flag")
        table = values
        for part in path[:-1]:
            table = table.setdefault(part, {})
        table[path[-1]] = value
    try:
        return config.overlay(values)
    except SettingError as error:
        if error.path in names:
            raise InputError(f"{names[error.path]}{error.problem}") from None
        raise


def _describe(field: FieldInfo) -> str:
    """Return the text for --help of a setting, with its unit."""
    text = (field.description or "").rstrip(".")
    return ", ".join(filter(None, (text[:1].lower() + text[1:], about(field, "unit"))))
