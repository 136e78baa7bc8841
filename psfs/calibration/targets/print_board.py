"""A ChArUco board as a PDF page in its true size."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Path2D

from cl import InputError
from psfs.calibration.targets.boards import choose_dictionary
from psfs.common.files import write_atomically
from psfs.common.numbers import INCH

#: White rim around the board, and the room below it for the text and the ruler, mm.
_RIM, _BELOW = 10.0, 12.0
#: Greatest length of the ruler, mm, by which the printed size is checked.
_RULER = 100.0
#: Shortest side of a marker, mm: printers draw no finer ones.
_LEAST = 1.0
#: Longest side of a page that is written, mm; corners of a square.
_LONGEST, _SQUARE = 5000.0, np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)])


def write_board_pdf(
    path: Path, squares: tuple[int, int], sides: tuple[float, float], dictionary: str,
    boards: int = 1,
) -> tuple[float, float]:  # fmt: skip
    """Write ChArUco boards of `squares` (columns, rows) as vectors, a page each; return the page's
    size, mm.

    sides: of squares and markers, m. boards: their markers are numbered on. Below each board stand
    the flags that describe it, and a ruler. Raises InputError for a board that OpenCV cannot make
    or that is too large.
    """
    columns, rows = squares
    side, inner = 1000 * sides[0], 1000 * sides[1]
    width, height = columns * side + 2 * _RIM, rows * side + 2 * _RIM + _BELOW
    if not _LEAST <= inner < side or max(width, height) > _LONGEST or min(squares) < 3:
        raise InputError(
            f"a board of {columns}x{rows} squares of {side:g} mm with markers of {inner:g} mm; "
            f"expected 3x3 or more, markers of {_LEAST:g} mm or more that are smaller than the "
            f"squares, and {_LONGEST:g} mm at most"
        )
    count = columns * rows // 2
    markers = choose_dictionary(dictionary, boards * count)
    if len(markers.bytesList) < boards * count:
        raise InputError(
            f"the board has {boards * count} markers; {dictionary} has {len(markers.bytesList)}: "
            "choose another --dictionary"
        )
    ruler = min(_RULER, columns * side)
    text = (
        f"--board charuco --squares {columns}x{rows} --square {sides[0]:g} --marker {sides[1]:g} "
        f"--dictionary {dictionary}      print at 100 %; this line must measure {ruler:g} mm:"
    )
    with write_atomically(path) as temporary, temporary.open("wb") as file, PdfPages(file) as pages:
        for number in range(boards):
            figure = Figure(figsize=(width / 1000 / INCH, height / 1000 / INCH))
            axes = figure.add_axes((0, 0, 1, 1))
            axes.set_xlim(-_RIM, width - _RIM)
            axes.set_ylim(height - _RIM, -_RIM)  # millimetres, down, from the board's corner
            axes.axis("off")
            black = list_black_squares(squares, side, inner, markers, number * count)
            outlines = [Path2D((x, y) + width * _SQUARE, closed=True) for x, y, width in black]
            whole = Path2D.make_compound_path(*outlines)  # several would leave bright seams
            axes.add_patch(PathPatch(whole, facecolor="black", linewidth=0))
            bottom = rows * side + _RIM
            heading = f"board {number + 1} of {boards}      " if boards > 1 else ""
            axes.text(0, bottom, heading + text, fontsize=6, va="center")
            axes.plot([0, ruler], [bottom + 5] * 2, color="black", linewidth=0.8)
            pages.savefig(figure)
    return width, height


def list_black_squares(
    squares: tuple[int, int], side: float, inner: float, markers: cv2.aruco.Dictionary,
    first: int = 0,
) -> np.ndarray:  # fmt: skip
    """Return left, top and side (N, 3), mm, of everything black, in OpenCV's order of markers.

    side, inner: of squares and markers, mm. first: number of the first marker.
    """
    squares_black: list[tuple[float, float, float]] = []
    bits = markers.markerSize + 2  # with the black rim
    module, number, off = inner / bits, first, (side - inner) / 2
    for row in range(squares[1]):
        for column in range(squares[0]):
            left, top = column * side, row * side
            if (row + column) % 2 == 0:
                squares_black.append((left, top, side))
                continue
            picture = cv2.aruco.generateImageMarker(markers, number, bits)
            number += 1
            for y, x in np.argwhere(picture == 0):
                squares_black.append((left + off + x * module, top + off + y * module, module))
    return np.array(squares_black)
