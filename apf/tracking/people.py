"""The tracks of several people: a folder for each, and `people.json`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, overload

import numpy as np
from pydantic import Field

from apf.tracking.track import PEOPLE, Track, spans
from cl import InputError
from psfs.common.files import name_file_in_errors, read_json, write_json
from psfs.common.schema import Table, parse_values

#: Greatest number of people.
MOST_PEOPLE = 20
_SPANS = r"^(\d{1,7}(-\d{1,7})?(, \d{1,7}(-\d{1,7})?)*)?$"


@dataclass(frozen=True, eq=False, repr=False)
class PeopleTracks(Sequence[Track]):
    """The tracks of the people of a take: `for track in tracks`.

    tracks: one for each person, the largest person first, each from the first to the last frame
    that shows the person. frames: (F,) numbers of the frames that were searched. seen: for each
    person the numbers (F_p,) of those that show the person. objects: number of other things that
    move. verdicts: how good each track looks, see `apf.report.quality`; empty if not judged.
    """

    tracks: tuple[Track, ...]
    frames: np.ndarray
    seen: tuple[np.ndarray, ...]
    objects: int = 0
    verdicts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(self.tracks) != len(self.seen):
            raise InputError(
                f"{len(self.tracks)} tracks and {len(self.seen)} lists of frames; expected one "
                "list for each track"
            )
        if len(self.verdicts) != len(self.tracks):
            object.__setattr__(self, "verdicts", ("",) * len(self.tracks))

    def __len__(self) -> int:
        return len(self.tracks)

    def __repr__(self) -> str:
        lengths = ", ".join(str(len(seen)) for seen in self.seen)
        return f"<PeopleTracks of {len(self)} in {len(self.frames)} frames: seen in {lengths}>"

    def __iter__(self) -> Iterator[Track]:
        return iter(self.tracks)

    @overload
    def __getitem__(self, index: int) -> Track: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Track, ...]: ...
    def __getitem__(self, index: int | slice) -> Track | tuple[Track, ...]:
        return self.tracks[index]

    @property
    def counts(self) -> np.ndarray:
        """Number (F,) of people in each of `frames`."""
        return np.sum([np.isin(self.frames, seen) for seen in self.seen], axis=0, dtype=int)

    def select_seen(self, number: int) -> Track:
        """Return a person's track in the frames alone that show the person."""
        track = self.tracks[number]
        return track.select(np.isin(track.frames, self.seen[number]))

    def save(self, folder: str | Path) -> None:
        """Write `track.npz` of each person into folders `person1`, `person2` ... of `folder`, and
        `people.json`."""
        for number, track in enumerate(self.tracks, start=1):
            path = person_folder(Path(folder), number)
            path.mkdir(parents=True, exist_ok=True)
            track.save(path / "track.npz")
        self.save_list(folder)

    def save_list(self, folder: str | Path) -> None:
        """Write `people.json` alone."""
        persons = [
            {
                "folder": person_folder(Path(), number).name,
                "frames": len(seen),
                "seen": spans(seen.tolist()),
                "verdict": verdict,
            }
            for number, (seen, verdict) in enumerate(
                zip(self.seen, self.verdicts, strict=True), start=1
            )
        ]
        with_people = {str(n): int(k) for n, k in enumerate(np.bincount(self.counts)) if k}
        facts = {
            "people": len(self),
            "objects": self.objects,
            "frames": spans(self.frames.tolist()),
            "frames_with": with_people,
            "persons": persons,
        }
        write_json(Path(folder) / PEOPLE, facts)

    @classmethod
    def of(cls, *tracks: Track) -> PeopleTracks:
        """Return tracks that show everybody in the same frames."""
        return cls(tracks, tracks[0].frames, (tracks[0].frames,) * len(tracks))

    @classmethod
    def open(cls, folder: str | Path) -> PeopleTracks:
        """Return the tracks in a folder that `save` or `apf track` wrote, or that of one person,
        see `Track.open`. Raises InputError if one is missing or invalid."""
        folder = Path(folder)
        if not holds_people(folder):
            return cls.of(Track.open(folder))
        listed = _read_list(folder)
        with name_file_in_errors(folder / PEOPLE):
            frames = parse_spans(listed.frames)
            seen = tuple(parse_spans(person.seen) for person in listed.persons)
        tracks = tuple(Track.open(folder / person.folder) for person in listed.persons)
        verdicts = tuple(person.verdict for person in listed.persons)
        return cls(tracks, frames, seen, listed.objects, verdicts)


class _Person(Table):
    """One person in a list of people."""

    folder: Annotated[str, Field(pattern=r"^person\d{1,3}$")]
    frames: int
    seen: Annotated[str, Field(pattern=_SPANS)]
    verdict: str = ""


class _Listed(Table):
    """The content of `people.json`."""

    people: int
    objects: int
    frames: Annotated[str, Field(pattern=_SPANS)]
    persons: Annotated[list[_Person], Field(min_length=1, max_length=MOST_PEOPLE)]


def _read_list(folder: Path) -> _Listed:
    """Read `people.json`. Raises InputError."""
    path, what = folder / PEOPLE, "the people of an `apf track`"
    listed = parse_values(_Listed, read_json(path, what), path)
    folders = [person.folder for person in listed.persons]
    if len(set(folders)) < len(folders) or listed.people != len(folders):
        raise InputError(
            f"{path}: {listed.people} people in the folders {', '.join(folders)}; expected "
            "one of its own for each"
        )
    return listed


def list_people(folder: Path) -> list[Path]:
    """Return the folders of the people of a run of several: those that `people.json` lists, or,
    while they are tracked, those with a track. Raises InputError for an invalid list."""
    if holds_people(folder):
        return [folder / person.folder for person in _read_list(folder).persons]
    folders = [path for path in folder.glob("person*") if (path / "track.npz").is_file()]
    return sorted(folders, key=lambda path: (len(path.name), path.name))


def person_folder(folder: Path, number: int) -> Path:
    """Return the folder of the person with a `number` from 1 on."""
    return folder / f"person{number}"


def holds_people(folder: Path) -> bool:
    """Return whether a folder holds the tracks of several people."""
    return (folder / PEOPLE).is_file()


def parse_spans(text: str) -> np.ndarray:
    """Return the frame numbers (F,) of a text like `3, 25-32`, see `spans`. Raises InputError
    unless they ascend."""
    pieces = [piece.partition("-") for piece in text.split(", ")] if text else []
    ends = [(int(low), int(high or low)) for low, _, high in pieces]
    highest = -1
    for low, high in ends:
        if not highest < low <= high:
            raise InputError(f"frames {text[:80]}; expected them ascending, as 3, 25-32")
        highest = high
    return np.concatenate([np.zeros(0, int), *(np.arange(low, high + 1) for low, high in ends)])
