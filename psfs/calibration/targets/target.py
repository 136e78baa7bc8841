"""What is waved through the volume: points that keep their distances, and who saw them where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cl import InputError
from psfs.common.ranges import check_number

#: Shares of a wand's length, between which the order of three markers is not taken from a picture.
_ALIKE = (0.9, 1 / 0.9)


@dataclass(frozen=True, eq=False)
class Target:
    """A rigid board or wand.

    name: for messages. points: (P, 3) m, in its own axes. orders: (S, P), the orders in which a
    camera may take its points, the right one first; a wand with equal ends has two. known: where
    its points are in the world, (P, 3) m by frame, if that was measured, else None.
    """

    name: str
    points: np.ndarray
    orders: np.ndarray
    known: Mapping[int, np.ndarray] | None = None

    @property
    def planar(self) -> bool:
        """Is its pose known from a single picture, as a board's is?"""
        return bool(np.linalg.matrix_rank(self.points - self.points[0], tol=1e-6) == 2)

    def at(self, frame: int) -> np.ndarray:
        """Return the points (P, 3) m to which the frame's pose is applied."""
        return self.points if self.known is None else self.known[frame]


@dataclass(frozen=True, eq=False)
class Sighting:
    """The target in one picture: which of its points, ids (N,), at which pixels (N, 2)."""

    frame: int
    view: int
    ids: np.ndarray
    pixels: np.ndarray

    def ordered(self, order: np.ndarray) -> Sighting:
        """Return the same pixels as other points: id k becomes order[k]."""
        return replace(self, ids=order[self.ids])


def by_frame(sightings: Sequence[Sighting]) -> dict[int, list[Sighting]]:
    """Return the sightings of every frame."""
    found: dict[int, list[Sighting]] = {}
    for sighting in sightings:
        found.setdefault(sighting.frame, []).append(sighting)
    return found


def by_view(sightings: Sequence[Sighting], views: int) -> list[list[Sighting]]:
    """Return the sightings of every camera."""
    found: list[list[Sighting]] = [[] for _ in range(views)]
    for sighting in sightings:
        found[sighting.view].append(sighting)
    return found


def check_squares(squares: tuple[int, int], square: float) -> None:
    """Raise InputError unless a board of so many squares, `square` m wide each, can be."""
    if min(squares) < 3 or max(squares) > 100:
        raise InputError(f"a board of {squares[0]}x{squares[1]} squares; expected 3 to 100")
    check_number("square (m)", square, 0.001, 2)


def chessboard(squares: tuple[int, int], square: float) -> Target:
    """Return the inner corners of a chessboard of `squares` = (columns, rows), by rows: X along
    them, Y down, Z into the board. Raises InputError for one that looks alike from all sides."""
    check_squares(squares, square)
    columns, rows = squares[0] - 1, squares[1] - 1
    if columns == rows:
        raise InputError(
            f"a chessboard of {squares[0]}x{squares[1]} squares looks alike from four sides; "
            "expected other numbers, or a ChArUco board"
        )
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    points = square * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], -1)
    order = np.arange(len(points))
    # Turned by half a circle it has the same colours where both numbers are even, or both odd.
    orders = [order] if (columns + rows) % 2 else [order, order[::-1]]
    return Target(f"chessboard of {squares[0]}x{squares[1]} squares", points, np.stack(orders))


def wand(lengths: Sequence[float]) -> Target:
    """Return the markers of a wand, `lengths` m from each to the next, along X. Raises InputError
    for lengths that cannot be."""
    if not 1 <= len(lengths) <= 2:
        raise InputError(f"a wand of {len(lengths) + 1} markers; expected two or three")
    for length in lengths:
        check_number("wand (m)", length, 0.01, 10)
    points = np.zeros((len(lengths) + 1, 3))
    points[1:, 0] = np.cumsum(lengths)
    order = np.arange(len(points))
    told = len(lengths) == 2 and not _ALIKE[0] < lengths[0] / lengths[1] < _ALIKE[1]
    orders = [order] if told else [order, order[::-1]]
    name = "wand of " + " and ".join(f"{length:g}" for length in lengths) + " m"
    return Target(name, points, np.stack(orders))
