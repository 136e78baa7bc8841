"""The varied settings: the dimensions, their values, and the tables over them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any

from cl import InputError


@dataclass(frozen=True)
class Setting:
    """All that distinguishes runs but their seed. step: every `step`-th frame is used. start: the
    first pose, "true" from the true joints, "found" from the images alone, "none" for
    triangulation, which has no pose. observations: one of `OBSERVATIONS`. preset: a
    paper's settings or one of `ABLATIONS`, the base that the other fields change; "" for the
    defaults."""

    sequence: str
    cameras: int
    step: int
    method: str
    objective: str
    particles: int
    layers: int
    start: str = "true"
    observations: str = "voxels"
    preset: str = ""

    @property
    def recording(self) -> tuple[str, int, int, str]:
        """The settings that choose a recording: those of one are done together."""
        return self.sequence, self.cameras, self.step, self.preset


#: The observations of a suite's runs: keypoints triangulated, without a body; the voxels; the
#: keypoints instead of voxels; voxels and keypoints.
OBSERVATIONS = ("triangulation", "voxels", "keypoints", "both")
#: The dimensions of tables, with their headings.
DIMENSIONS = {
    "cameras": "cameras",
    "step": "every n-th frame",
    "method": "method",
    "objective": "objective",
    "particles": "particles",
    "layers": "layers",
}
#: Tables by default: dimensions joined by colons, the last one in columns.
DEFAULT_TABLES = ("cameras", "step", "particles:layers", "method:objective")


@dataclass(frozen=True)
class Table:
    """Table of runs in which `dimensions` vary and the others keep their first value."""

    dimensions: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Table:
        """Parse dimensions joined by colons. Raises InputError for unknown ones."""
        dimensions = tuple(text.split(":"))
        unknown = [name for name in dimensions if name not in DIMENSIONS]
        if unknown or len(set(dimensions)) < len(dimensions):
            raise InputError(
                f"--tables {text}; expected different ones of {', '.join(DIMENSIONS)}, "
                "joined by colons"
            )
        return cls(dimensions)

    @property
    def name(self) -> str:
        return ":".join(self.dimensions)

    @property
    def title(self) -> str:
        return ", ".join(DIMENSIONS[name] for name in self.dimensions)

    def settings(self, sequence: str, values: Mapping[str, list[Any]]) -> Iterator[Setting]:
        """Return every combination; the last dimension varies fastest."""
        base = base_setting(sequence, values)
        for combination in product(*(values[name] for name in self.dimensions)):
            yield replace(base, **dict(zip(self.dimensions, combination, strict=True)))

    def rows(self, settings: Iterable[Setting]) -> list[tuple[Any, ...]]:
        """Return the distinct rows: sequence, then values of all dimensions but the last; numbers
        ascend within a sequence."""
        found = list(dict.fromkeys(self.row_key(setting) for setting in settings))
        if not all(isinstance(value, int) for row in found for value in row[1:]):
            return found
        sequences = list(dict.fromkeys(row[0] for row in found))
        return sorted(found, key=lambda row: (sequences.index(row[0]), row[1:]))

    def columns(self, settings: Iterable[Setting]) -> list[Any]:
        """Return the distinct columns; numbers ascend."""
        found = list(dict.fromkeys(self.column_key(setting) for setting in settings))
        return sorted(found) if all(isinstance(column, int) for column in found) else found

    def row_key(self, setting: Setting) -> tuple[Any, ...]:
        values = asdict(setting)
        return (setting.sequence, *(values[name] for name in self.dimensions[:-1]))

    def column_key(self, setting: Setting) -> Any:
        return asdict(setting)[self.dimensions[-1]]


def base_setting(sequence: str, values: Mapping[str, list[Any]]) -> Setting:
    """Return the setting with the first value of every dimension."""
    return Setting(sequence, **{name: values[name][0] for name in DIMENSIONS})
