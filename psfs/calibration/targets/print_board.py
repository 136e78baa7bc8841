"""A ChArUco board as a PDF page in its true size."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Path2D

from cl import InputError
from psfs.calibration.targets.dictionaries import DICTIONARIES
from psfs.common.files import write_atomically

_MM_PER_INCH = 25.4
#: White rim around the board, and the room below it for the text and the ruler, mm.
_RIM, _BELOW = 10.0, 12.0
#: Length of the ruler, mm, by which the printed size is checked.
_RULER = 100.0
#: Shortest side of a marker, mm: printers draw no finer ones.
_LEAST = 1.0
#: Longest side of a page that is written, mm.
_LONGEST = 5000.0


def write_board_pdf(
    path: Path, squares: tuple[int, int], square: float, marker: float, dictionary: str
) -> tuple[float, float]:
    """Write a ChArUco board of `squares` (columns, rows) as vectors; return the page's size, mm.

    square, marker: sides, m. Below the board stand the flags that describe it, and a ruler. Raises
    InputError for a board that OpenCV cannot make or that is too large.
    """
    columns, rows = squares
    side, inner = 1000 * square, 1000 * marker
    width, height = columns * side + 2 * _RIM, rows * side + 2 * _RIM + _BELOW
    sides = _LEAST <= inner < side
    if not sides or max(width, height) > _LONGEST or min(squares) < 3:
        raise InputError(
            f"a board of {columns}x{rows} squares of {side:g} mm with markers of {inner:g} mm; "
            f"expected 3x3 or more, markers of {_LEAST:g} mm or more that are smaller than the "
            f"squares, and {_LONGEST:g} mm at most"
        )
    markers = _choose_markers(dictionary, columns * rows // 2)
    figure = Figure(figsize=(width / _MM_PER_INCH, height / _MM_PER_INCH))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(-_RIM, width - _RIM)
    axes.set_ylim(height - _RIM, -_RIM)  # millimetres, down, from the board's corner
    axes.axis("off")
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)])
    black = list_black_squares(squares, side, inner, markers)
    outlines = [Path2D((left, top) + across * corners, closed=True) for left, top, across in black]
    # One path, for side by side squares would leave bright seams.
    merged = Path2D.make_compound_path(*outlines)
    axes.add_patch(PathPatch(merged, facecolor="black", linewidth=0))
    text = (
        f"--board charuco --squares {columns}x{rows} --square {square:g} --marker {marker:g} "
        f"--dictionary {dictionary}      print at 100 %; this line must measure 100 mm:"
    )
    bottom = rows * side + _RIM
    axes.text(0, bottom, text, fontsize=6, va="center")
    axes.plot([0, min(_RULER, columns * side)], [bottom + 5] * 2, color="black", linewidth=0.8)
    with write_atomically(path) as temporary, temporary.open("wb") as file:
        figure.savefig(file, format="pdf")
    return width, height


def _choose_markers(dictionary: str, needed: int) -> cv2.aruco.Dictionary:
    """Return the smallest set of a family with as many markers. Raises InputError without one."""
    for name in DICTIONARIES[dictionary]:
        markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        if len(markers.bytesList) >= needed:
            return markers
    raise InputError(
        f"the board has {needed} markers; {dictionary} has {len(markers.bytesList)}: "
        "choose another --dictionary"
    )


def list_black_squares(
    squares: tuple[int, int], side: float, inner: float, markers: cv2.aruco.Dictionary
) -> np.ndarray:
    """Return left, top and side (N, 3), mm, of everything black, in OpenCV's order of markers.

    side, inner: of squares and markers, mm.
    """
    found: list[tuple[float, float, float]] = []
    bits = markers.markerSize + 2  # with the black rim
    module, number, off = inner / bits, 0, (side - inner) / 2
    for row in range(squares[1]):
        for column in range(squares[0]):
            left, top = column * side, row * side
            if (row + column) % 2 == 0:
                found.append((left, top, side))
                continue
            picture = cv2.aruco.generateImageMarker(markers, number, bits)
            number += 1
            for y, x in np.argwhere(picture == 0):
                found.append((left + off + x * module, top + off + y * module, module))
    return np.array(found)
