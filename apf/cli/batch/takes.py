"""The takes of a batch: folders, and TOML lists of folders with their own settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from cl import InputError
from psfs.cli.commandline import warn
from psfs.common.files import resolve_path
from psfs.common.toml import read_toml


@dataclass(frozen=True)
class ListedTake:
    """A take as requested: its folder, its name if one was given, its own settings as command-line
    arguments, and their source, for errors."""

    source: Path
    name: str | None = None
    words: tuple[str, ...] = ()
    where: str = "apf batch"


def list_takes(folders: list[str]) -> list[ListedTake]:
    """Return the takes that the command names. Raises InputError."""
    takes: list[ListedTake] = []
    for given in map(Path, folders):
        if given.suffix == ".toml" and given.exists() and not given.is_dir():
            takes += _read_list(given)
        elif given.is_file():
            warn(f"{given}: no folder; left out")  # `takes/*` also matches files such as notes
        else:
            takes.append(ListedTake(resolve_path(given)))
    if not takes:
        raise InputError("no take is named; expected folders, or a TOML list of them")
    return takes


def _read_list(path: Path) -> list[ListedTake]:
    """Return the takes of a list: [[take]] with folder, optional name, and flags of `apf track` by
    their names; [defaults] hold for takes that do not set them."""
    content = read_toml(path)
    defaults, takes = content.pop("defaults", {}), content.pop("take", None)
    if content or not isinstance(defaults, dict) or not _tables(takes):
        found = ", ".join(content) or "no list of takes"
        raise InputError(f"{path}: found {found}; expected [[take]] tables, and perhaps [defaults]")
    listed = []
    for number, stated in enumerate(takes, 1):
        where = f"{path}: take {number}"
        settings = {_flag(k): v for part in (defaults, stated) for k, v in part.items()}
        if "help" in settings:
            raise InputError(f"{where}: found help; expected settings of a take")
        folder, name = settings.pop("folder", None), settings.pop("name", None)
        if not isinstance(folder, str) or not isinstance(name, str | None):
            raise InputError(f"{where}: folder = {folder!r}, name = {name!r}; expected text")
        source = resolve_path(path.parent / folder)
        words = _words(settings, path.parent, where)
        listed.append(ListedTake(source, name, words, where))
    return listed


def _tables(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, dict) for v in value)


def _flag(name: str) -> str:
    return name.replace("_", "-")


def _words(settings: Mapping[str, object], folder: Path, where: str) -> tuple[str, ...]:
    """Convert settings to flags: `{"height": 1.8}` to `--height=1.8`, `{"all-cameras": true}` to
    `--all-cameras`. Paths are relative to the list's `folder`."""
    words: list[str] = []
    for name, value in settings.items():
        if isinstance(value, list):
            value = ",".join(map(str, value))
        if isinstance(value, bool):
            words += [f"--{name}"] * value
        elif isinstance(value, str) and ("/" in value or "." in value):
            named = resolve_path(folder / value)
            words.append(f"--{name}={named if named.exists() else value}")
        elif isinstance(value, str | int | float):
            words.append(f"--{name}={value}")
        else:
            raise InputError(f"{where}: {name} = {value!r}; expected text, a number or true")
    return tuple(words)
