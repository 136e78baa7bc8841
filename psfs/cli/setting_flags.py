"""Command-line flags that are derived from the settings whose fields name a flag."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from typing import Any

from pydantic.fields import FieldInfo

from cl import InputError
from psfs.common.config import C, Config, SettingError, about, field_kinds, fields_below

Names = tuple[str, ...]


def flagged(kind: type[Config]) -> Iterator[tuple[Names, FieldInfo]]:
    """Yield the settings with a flag of a class and its parts, each with the path of names that
    leads to it; the last name is the flag's destination."""
    for path, field in fields_below(kind):
        if about(field, "flag"):
            yield path, field


def add_setting_flags(
    group: Any,
    kind: type[Config],
    default: Callable[[Names, FieldInfo], str] | None = None,
    fill: bool = False,
) -> None:
    """Add the flags of a class of settings and its parts to a parser or a group; a flag that
    several settings share is added once. default: text for --help about the value without the flag.
    fill: give the flags the settings' defaults, so that they are written beside results."""
    added = set()
    for path, field in flagged(kind):
        flag, *_ = field_kinds(field)
        name = about(field, "flag")
        if name in added:
            continue
        added.add(name)
        what = about(field, "flag_help") or _described(field)
        usual = default(path, field) if default else str(field.default)
        group.add_argument(
            name,
            dest=path[-1],
            type=flag if flag in (int, float) else str,
            default=field.default if fill else None,
            help=f"{what} (default: {usual})",
        )


def with_flags(config: C, args: argparse.Namespace, without: tuple[str, ...] = ()) -> C:
    """Return the settings with the values that flags state, except those below the parts in
    `without`. Raises InputError that names the flag."""
    values: dict[str, Any] = {}
    names: dict[str, str] = {}
    for path, field in flagged(type(config)):
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
        return config.overlaid(values)
    except SettingError as error:
        if error.path in names:
            raise InputError(f"{names[error.path]}{error.problem}") from None
        raise


def _described(field: FieldInfo) -> str:
    """Return the text for --help of a setting, with its unit."""
    text = (field.description or "").rstrip(".")
    return ", ".join(filter(None, (text[:1].lower() + text[1:], about(field, "unit"))))
