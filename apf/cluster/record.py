"""What finished a folder of results: contents of inputs, settings, version; and what it holds."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from cl import InputError
from psfs.common.files import unreadable, write_json
from psfs.output.reconstruction_folder import versions

RECORD = "take.json"
_LOT = 1 << 22  # bytes read at a time


@dataclass(frozen=True)
class FileFacts:
    """A file's size, bytes, when it was changed, ns, and the SHA-256 of its content."""

    size: int
    mtime_ns: int
    sha256: str

    @classmethod
    def of(cls, path: Path, known: FileFacts | None = None) -> FileFacts:
        """Read the file, unless size and time are those `known`. Raises InputError."""
        try:
            stat = path.stat()
            if known is not None and (stat.st_size, stat.st_mtime_ns) == known.looks:
                return known
            digest = hashlib.sha256()
            with path.open("rb") as file:
                while lot := file.read(_LOT):
                    digest.update(lot)
        except OSError as error:
            raise unreadable(path, error) from None
        return cls(stat.st_size, stat.st_mtime_ns, digest.hexdigest())

    @property
    def looks(self) -> tuple[int, int]:
        return self.size, self.mtime_ns

    @property
    def content(self) -> tuple[int, str]:
        return self.size, self.sha256


@dataclass(frozen=True)
class TakeRecord:
    """What a folder of results was made of. inputs: by path in the take's folder. settings: plain
    values by the flags' names; of those that name a file the content counts, under `files`.
    outputs: by path in the folder of results. row: what `TakeRow` says of it."""

    version: str
    settings: Mapping[str, Any]
    inputs: Mapping[str, FileFacts]
    files: Mapping[str, FileFacts]
    outputs: Mapping[str, FileFacts] = field(default_factory=dict)
    rows: tuple[Mapping[str, Any], ...] = ()

    @classmethod
    def of_take(
        cls, folder: Path, settings: Mapping[str, Any], known: TakeRecord | None = None
    ) -> TakeRecord:
        """Return the record of a take that is to be done; files that look as those `known` are
        not read again. Raises InputError where one cannot be read."""
        plain = {name: _plain(value) for name, value in settings.items()}
        named = {name: path for name, value in plain.items() for path in _named_files(value)}
        inputs = {str(path.relative_to(folder)): path for path in files_in(folder)}
        return cls(
            versions()["psfs-apf"],
            {name: value for name, value in plain.items() if name not in named},
            _facts(inputs, known.inputs if known else {}),
            _facts(named, known.files if known else {}),
        )

    @classmethod
    def read(cls, folder: Path) -> TakeRecord | None:
        """Return that in a folder of results; None where there is none, or one of another kind."""
        try:
            data = json.loads((folder / RECORD).read_text())
            for part in ("inputs", "files", "outputs"):
                data[part] = {name: FileFacts(**facts) for name, facts in data[part].items()}
            return cls(**{**data, "rows": tuple(data["rows"])})
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
            return None

    def same_take(self, other: TakeRecord) -> bool:
        """Were both made of the same contents, by the same version with the same settings?"""
        return (
            self.version == other.version
            and dict(self.settings) == dict(other.settings)
            and _contents(self.inputs) == _contents(other.inputs)
            and _contents(self.files) == _contents(other.files)
        )

    def holds(self, folder: Path) -> bool:
        """Is all there that was written into the folder of results, as it was written?"""
        try:
            return all(
                FileFacts.of(folder / name, facts).content == facts.content
                for name, facts in self.outputs.items()
            )
        except InputError:
            return False

    def write(self, folder: Path) -> None:
        """Write it into the folder of results. Raises InputError."""
        write_json(folder / RECORD, asdict(self))


def files_in(folder: Path) -> list[Path]:
    """Return all files in a folder and below, sorted, without hidden ones. Raises InputError if it
    is no folder."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected one with calibrated views")
    found = (path for path in folder.rglob("*") if path.is_file())
    return sorted(
        p for p in found if not any(n.startswith(".") for n in p.relative_to(folder).parts)
    )


def _facts(paths: Mapping[str, Path], known: Mapping[str, FileFacts]) -> dict[str, FileFacts]:
    return {name: FileFacts.of(path, known.get(name)) for name, path in paths.items()}


def _contents(facts: Mapping[str, FileFacts]) -> dict[str, tuple[int, str]]:
    return {name: fact.content for name, fact in facts.items()}


def _plain(value: Any) -> Any:
    """JSON's own types for a flag's value, as they are read back."""
    if isinstance(value, slice):
        return [value.start, value.stop, value.step]
    return json.loads(json.dumps(value, default=str))


def _named_files(value: Any) -> Iterable[Path]:
    """The file that a setting names; text without a folder or an ending is a name of its own."""
    if isinstance(value, str) and ("/" in value or "." in value) and Path(value).is_file():
        yield Path(value)
