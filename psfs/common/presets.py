"""Presets: settings under a name, in TOML files of the form that --config reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from cl import InputError
from psfs.common.toml import read_toml

#: The files of each preset, those of the part before first.
Presets: TypeAlias = Mapping[str, Sequence[Path]]


def find_presets(folder: Path, before: Presets | None = None) -> dict[str, list[Path]]:
    """Return the presets that lie in `folder`, NAME.toml each; one whose name is known `before`
    adds to that."""
    known = before or {}
    return {path.stem: [*known.get(path.stem, ()), path] for path in sorted(folder.glob("*.toml"))}


def read_preset(presets: Presets, name: str) -> dict[str, Any]:
    """Return the settings of a preset. Raises InputError for an unknown name."""
    if name not in presets:
        raise InputError(f"preset {name!r}; expected {', '.join(presets) or 'none'}")
    settings: dict[str, Any] = {}
    for path in presets[name]:
        settings = merge_tables(settings, read_toml(path))
    return settings


def merge_tables(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of both, table by table; where both state one, that of `above`."""
    joined = dict(below)
    for name, value in above.items():
        under = joined.get(name)
        both = isinstance(value, Mapping) and isinstance(under, Mapping)
        joined[name] = merge_tables(under, value) if both else value  # type: ignore[arg-type]
    return joined
