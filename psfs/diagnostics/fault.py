"""A fault of footage."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """A fault of the footage.

    kind: a word for programs. cameras: names of the faulty cameras; empty if the fault concerns
    all. text: what is wrong and what to do, in one line. late: lag in frames, if the kind is
    "late". serious: whether it is worth a warning, not only a note.
    """

    kind: str
    cameras: tuple[str, ...]
    text: str
    late: int = 0
    serious: bool = True

    def __str__(self) -> str:
        return self.text
