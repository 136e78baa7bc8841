"""Calibration targets, rigid sets of points, and their sightings in pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cl import InputError
from psfs.common.ranges import check_number

#: Ratio of two lengths of a wand up to which they are taken for the same.
EQUAL = 1.1


@dataclass(frozen=True, eq=False)
class Target:
    """A rigid board or wand.

    name: for messages. points: (P, 3) m, in its own axes. orders: (S, P), the orders in which a
    detector may return the points, the right one first; a wand with equal ends has two. known:
    measured positions of the points in the world, (P, 3) m by frame, or None. boards: number of
    alike boards, each of which makes a frame of the footage a frame of its own, see
    `find_sightings`.
    """

    name: str
    points: np.ndarray
    orders: np.ndarray
    known: Mapping[int, np.ndarray] | None = None
    boards: int = 1

    @property
    def planar(self) -> bool:
        """Whether a single picture determines its pose, as a board's does."""
        return bool(np.linalg.matrix_rank(self.points - self.points[0], tol=1e-6) == 2)

    def frame_points(self, frame: int) -> np.ndarray:
        """Return the points (P, 3) m to which the frame's pose is applied."""
        return self.points if self.known is None else self.known[frame]


@dataclass(frozen=True, eq=False)
class Sighting:
    """The target in one picture: ids (N,) of its points and their pixels (N, 2)."""

    frame: int
    view: int
    ids: np.ndarray
    pixels: np.ndarray

    def reorder(self, order: np.ndarray) -> Sighting:
        """Return the same pixels for other points: id k becomes order[k]."""
        return replace(self, ids=order[self.ids])


def group_by_frame(sightings: Sequence[Sighting]) -> dict[int, list[Sighting]]:
    """Group the sightings by frame."""
    groups: dict[int, list[Sighting]] = {}
    for sighting in sightings:
        groups.setdefault(sighting.frame, []).append(sighting)
    return groups


def select_shared(sightings: Sequence[Sighting], target: Target) -> list[Sighting]:
    """Return the sightings in frames with as many of them as tell the target's pose: two of a wand
    whose markers were not measured, else one."""
    least = 1 if target.planar or target.known is not None else 2
    by_frame = group_by_frame(sightings)
    return [s for s in sightings if len(by_frame[s.frame]) >= least]


def group_by_view(sightings: Sequence[Sighting], views: int) -> list[list[Sighting]]:
    """Group the sightings by camera."""
    groups: list[list[Sighting]] = [[] for _ in range(views)]
    for sighting in sightings:
        groups[sighting.view].append(sighting)
    return groups


def check_squares(squares: tuple[int, int], square: float) -> None:
    """Raise InputError unless the numbers of squares and their width, m, are plausible."""
    if min(squares) < 3 or max(squares) > 100:
        raise InputError(f"a board of {squares[0]}x{squares[1]} squares; expected 3 to 100")
    check_number("square (m)", square, 0.001, 2)


def make_chessboard(squares: tuple[int, int], square: float) -> Target:
    """Make a chessboard's inner corners, row by row: X along the rows, Y down, Z into the board.

    squares: (columns, rows). square: width, m. Raises InputError for a symmetric board, and for one
    that OpenCV does not search for.
    """
    check_squares(squares, square)
    columns, rows = squares[0] - 1, squares[1] - 1
    if min(columns, rows) < 3:
        raise InputError(
            f"a chessboard of {squares[0]}x{squares[1]} squares; expected 4 or more each way"
        )
    if columns == rows:
        raise InputError(
            f"a chessboard of {squares[0]}x{squares[1]} squares looks alike from four sides; "
            "expected other numbers, or a ChArUco board"
        )
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    points = square * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], -1)
    order = np.arange(len(points))
    # Rotated by half a turn it looks the same if both numbers are even or both odd.
    orders = [order] if (columns + rows) % 2 else [order, order[::-1]]
    return Target(f"chessboard of {squares[0]}x{squares[1]} squares", points, np.stack(orders))


def make_wand(lengths: Sequence[float]) -> Target:
    """Make a wand whose markers lie along X; lengths: m from each marker to the next.

    Raises InputError for implausible lengths.
    """
    if not 1 <= len(lengths) <= 2:
        raise InputError(f"a wand of {len(lengths) + 1} markers; expected two or three")
    for length in lengths:
        check_number("wand (m)", length, 0.01, 10)
    points = np.zeros((len(lengths) + 1, 3))
    points[1:, 0] = np.cumsum(lengths)
    order = np.arange(len(points))
    distinct = len(lengths) == 2 and max(lengths) >= EQUAL * min(lengths)
    orders = [order] if distinct else [order, order[::-1]]
    name = "wand of " + " and ".join(f"{length:g}" for length in lengths) + " m"
    return Target(name, points, np.stack(orders))
