"""A record of a finished take: contents of its inputs, settings, version, and outputs."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from cl import InputError
from psfs.common.files import read_json, write_json
from psfs.common.reading import open_input, parsing
from psfs.common.versions import versions

RECORD = "take.json"
_LOT = 1 << 22  # bytes read at a time


@dataclass(frozen=True)
class FileFacts:
    """A file's size, bytes, time of change, ns, and SHA-256."""

    size: int
    mtime_ns: int
    sha256: str

    @classmethod
    def read(cls, path: Path, known: FileFacts | None = None) -> FileFacts:
        """Read the file, unless its size and time equal those of `known`. Raises InputError."""
        with parsing(path, "a file"), open_input(path) as file:
            stat = os.fstat(file.fileno())
            if known is not None and (stat.st_size, stat.st_mtime_ns) == known.looks:
                return known
            digest = hashlib.sha256()
            while lot := file.read(_LOT):
                digest.update(lot)
        return cls(stat.st_size, stat.st_mtime_ns, digest.hexdigest())

    @property
    def looks(self) -> tuple[int, int]:
        return self.size, self.mtime_ns

    @property
    def content(self) -> tuple[int, str]:
        return self.size, self.sha256


@dataclass(frozen=True)
class TakeRecord:
    """The inputs of a folder of results, and its contents.

    inputs: by path in the take's folder. settings: plain values by the flags' names. files: the
    contents of files that settings name. outputs: by path in the folder of results. rows: the
    values of its `TakeRow`s.
    """

    version: str
    settings: Mapping[str, object]
    inputs: Mapping[str, FileFacts]
    files: Mapping[str, FileFacts]
    outputs: Mapping[str, FileFacts] = field(default_factory=dict)
    rows: tuple[Mapping[str, object], ...] = ()

    @classmethod
    def describe_take(
        cls, folder: Path, settings: Mapping[str, object], known: TakeRecord | None = None
    ) -> TakeRecord:
        """Describe a take that is to be tracked.

        Files that match those of `known` are not read again. Raises InputError if one cannot be
        read.
        """
        plain = {name: _to_json_types(value) for name, value in settings.items()}
        named = {name: path for name, value in plain.items() for path in _named_files(value)}
        inputs = {str(path.relative_to(folder)): path for path in list_files(folder)}
        return cls(
            versions()["psfs-apf"],
            {name: value for name, value in plain.items() if name not in named},
            _describe_files(inputs, known.inputs if known else {}),
            _describe_files(named, known.files if known else {}),
        )

    @classmethod
    def read(cls, folder: Path) -> TakeRecord | None:
        """Read the record of a folder of results; None if there is none of the right format."""
        try:
            data = read_json(folder / RECORD, "the record of a take")
            for part in ("inputs", "files", "outputs"):
                data[part] = {name: FileFacts(**facts) for name, facts in data[part].items()}
            return cls(**{**data, "rows": tuple(data["rows"])})
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
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
            return all(
                FileFacts.read(folder / name, facts).content == facts.content
                for name, facts in self.outputs.items()
            )
        except InputError:
            return False

    def write(self, folder: Path) -> None:
        """Write the record into the folder of results. Raises InputError."""
        write_json(folder / RECORD, asdict(self))


def list_files(folder: Path) -> list[Path]:
    """List all files in a folder and below, sorted, without hidden ones.

    Raises InputError if it is not a folder.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected one with calibrated views")
    found = (path for path in folder.rglob("*") if path.is_file())
    return sorted(
        p for p in found if not any(n.startswith(".") for n in p.relative_to(folder).parts)
    )


def _describe_files(
    paths: Mapping[str, Path], known: Mapping[str, FileFacts]
) -> dict[str, FileFacts]:
    return {name: FileFacts.read(path, known.get(name)) for name, path in paths.items()}


def _contents(facts: Mapping[str, FileFacts]) -> dict[str, tuple[int, str]]:
    return {name: fact.content for name, fact in facts.items()}


def _to_json_types(value: object) -> object:
    """Convert a flag's value to JSON types, as they are read back."""
    if isinstance(value, slice):
        return [value.start, value.stop, value.step]
    return json.loads(json.dumps(value, default=str))


def _named_files(value: object) -> Iterable[Path]:
    """Yield the file that a setting names; text without a folder or an ending is not a path."""
    if isinstance(value, str) and ("/" in value or "." in value) and Path(value).is_file():
        yield Path(value)
