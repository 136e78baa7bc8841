"""A record of a finished take: contents of its inputs, settings, version, and outputs."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

from cl import InputError, UserError
from psfs.common.files import read_json, write_json
from psfs.common.reading import open_input, parsing
from psfs.common.schema import parse_values
from psfs.common.system import versions

RECORD = "take.json"
#: Of a file: size, bytes; time of change, ns; SHA-256.
Facts = tuple[int, int, str]


@dataclass(frozen=True)
class TakeRecord:
    """The inputs of a folder of results, and its contents.

    settings: plain values by the flags' names. inputs: facts of the files by path in the take's
    folder. files: of files that settings name. outputs: by path in the folder of results. rows: the
    values of its `TakeRow`s.
    """

    version: str
    settings: Mapping[str, object]
    inputs: Mapping[str, Facts]
    files: Mapping[str, Facts]
    outputs: Mapping[str, Facts] = field(default_factory=dict)
    rows: tuple[Mapping[str, object], ...] = ()

    @classmethod
    def describe_take(
        cls, folder: Path, settings: Mapping[str, object], known: TakeRecord | None = None
    ) -> TakeRecord:
        """Describe a take that is to be tracked.

        Files whose size and time are those of `known` are not read again. Raises InputError if one
        cannot be read.
        """
        plain = json.loads(json.dumps(dict(settings), default=str))
        named = {
            name: Path(value)
            for name, value in plain.items()
            # text without a folder or an ending is no path
            if isinstance(value, str) and ("/" in value or "." in value) and Path(value).is_file()
        }
        return cls(
            versions()["psfs-apf"],
            {name: value for name, value in plain.items() if name not in named},
            describe_files(folder, list_files(folder), known.inputs if known else {}),
            {n: _describe(p, (known.files if known else {}).get(n)) for n, p in named.items()},
        )

    @classmethod
    def read(cls, folder: Path) -> TakeRecord | None:
        """Read the record of a folder of results; None if there is none of the right format."""
        with suppress(UserError):
            return parse_values(cls, read_json(folder / RECORD, "the record of a take"))
        return None

    def is_same_take(self, other: TakeRecord) -> bool:
        """Return whether both records have the same contents, version and settings."""
        return (
            self.version == other.version
            and dict(self.settings) == dict(other.settings)
            and _contents(self.inputs) == _contents(other.inputs)
            and _contents(self.files) == _contents(other.files)
        )

    def is_complete(self, folder: Path) -> bool:
        """Return whether all outputs are in the folder of results, unchanged."""
        try:
            files = describe_files(folder, [folder / name for name in self.outputs], self.outputs)
        except InputError:
            return False
        return _contents(files) == _contents(self.outputs)

    def write(self, folder: Path) -> None:
        """Write the record into the folder of results. Raises InputError."""
        write_json(folder / RECORD, asdict(self))


def list_files(folder: Path) -> list[Path]:
    """List all files in a folder and below, sorted, without hidden ones.

    Raises InputError if it is not a folder.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected one with calibrated views")
    files = (path for path in folder.rglob("*") if path.is_file())
    return sorted(
        p for p in files if not any(n.startswith(".") for n in p.relative_to(folder).parts)
    )


def describe_files(
    folder: Path, paths: Iterable[Path], known: Mapping[str, Facts] | None = None
) -> dict[str, Facts]:
    """Return the facts of files by their path in `folder`; those whose size and time are `known`
    are not read. Raises InputError."""
    names = {str(path.relative_to(folder)): path for path in paths}
    return {name: _describe(path, (known or {}).get(name)) for name, path in names.items()}


def _describe(path: Path, known: Facts | None) -> Facts:
    with parsing(path, "a file"), open_input(path) as file:
        stat = os.fstat(file.fileno())
        if known is not None and (stat.st_size, stat.st_mtime_ns) == known[:2]:
            return known
        digest = hashlib.sha256()
        while lot := file.read(1 << 22):
            digest.update(lot)
    return stat.st_size, stat.st_mtime_ns, digest.hexdigest()


def _contents(facts: Mapping[str, Facts]) -> dict[str, tuple[int, str]]:
    return {name: (size, sha256) for name, (size, _, sha256) in facts.items()}
