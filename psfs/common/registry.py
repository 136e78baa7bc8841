"""Registries of what can be chosen by name: entries of this program and of other installed
packages."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import Protocol, TypeVar

log = logging.getLogger(__name__)


class Named(Protocol):
    """Entry of a registry, with the name by which it is chosen."""

    @property
    def name(self) -> str: ...


T = TypeVar("T", bound=Named)


class Registry(Mapping[str, T]):
    """The entries of one `kind` by name: `entries`, this program's own, then those of others.

    group: of entry points, by which another package registers an entry or a tuple of entries. They
    are loaded when the first entry is asked for. An entry point that fails, or has a name that is
    taken, is left out with a warning.
    """

    def __init__(self, kind: type[T], group: str, entries: tuple[T, ...]) -> None:
        self._kind, self._own, self.group = kind, entries, group

    @cached_property
    def _entries(self) -> dict[str, T]:
        entries: dict[str, T] = {}
        self._add(entries, self._own)
        for point in sorted(entry_points(group=self.group), key=lambda point: point.name):
            try:
                self._add(entries, point.load())
            except Exception as error:  # whatever another package does
                log.warning("%s is left out: %s", _describe(point), error)
        return entries

    def _add(self, entries: dict[str, T], loaded: object) -> None:
        for entry in loaded if isinstance(loaded, tuple) else (loaded,):
            if not isinstance(entry, self._kind):
                raise TypeError(f"it is {entry!r}; expected a {self._kind.__name__}")
            if entry.name in entries:
                raise ValueError(f"there is a {self._kind.__name__} {entry.name!r} already")
            entries[entry.name] = entry

    def __getitem__(self, name: str) -> T:
        if not isinstance(name, str):  # `in` is asked of anything that stands in a file
            raise KeyError(name)
        return self._entries[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)


def _describe(point: EntryPoint) -> str:
    package = "" if point.dist is None else f" of the package {point.dist.name}"
    return f"the entry point {point.name} = {point.value} ({point.group}){package}"
