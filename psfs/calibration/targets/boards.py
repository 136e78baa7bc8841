"""Detect calibration boards in pictures with OpenCV."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from cl import InputError
from psfs.calibration.targets.dictionaries import DICTIONARIES
from psfs.calibration.targets.target import Target, check_squares, make_chessboard
from psfs.cameras.names import join_names
from psfs.common.ranges import check_number

#: Fewest corners of a ChArUco board that determine its pose, and fewest rows and columns they span.
_CORNERS, _LINES = 6, 2
#: Largest deviation of corners from a homography, in squares; lenses cause some.
_MAX_DEVIATION = 0.3

Found = tuple[np.ndarray, np.ndarray]


def to_grey(picture: np.ndarray) -> np.ndarray:
    """Convert a BGR picture to grey levels (h, w) uint8."""
    return cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)


class ChessboardFinder:
    """Detector of all inner corners of a chessboard.

    cv2.findChessboardCorners, which is fast, finds the board; cv2.findChessboardCornersSB, which is
    more exact, then searches that region only.
    """

    def __init__(self, squares: tuple[int, int], square: float) -> None:
        self.target = make_chessboard(squares, square)
        self.corners = squares[0] - 1, squares[1] - 1

    def __call__(self, view: int, picture: np.ndarray) -> Found | None:
        """Return ids (N,) and pixels (N, 2) of the target's points; None if it is not seen."""
        grey = to_grey(picture)
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        flags |= cv2.CALIB_CB_FAST_CHECK
        is_seen, corners = cv2.findChessboardCorners(grey, self.corners, flags=flags)
        if not is_seen:
            return None
        exact = self._refine_corners(grey, corners.reshape(*self.corners[::-1], 2))
        if exact is None:
            return None
        return np.arange(len(self.target.points)), self._order_as_board(grey, exact).reshape(-1, 2)

    def _refine_corners(self, grey: np.ndarray, corners: np.ndarray) -> np.ndarray | None:
        """Refine the corners (rows, columns, 2) to subpixel accuracy.

        None if they do not lie on a plane, as when the detector invents corners outside the
        picture.
        """
        steps = [np.linalg.norm(np.diff(corners, axis=axis), axis=-1) for axis in (0, 1)]
        margin = 2 * max(step.max() for step in steps)
        low = np.maximum(corners.min(axis=(0, 1)) - margin, 0).astype(int)
        high = (corners.max(axis=(0, 1)) + margin).astype(int) + 1
        region = grey[low[1] : high[1], low[0] : high[0]]
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
        is_seen, exact = cv2.findChessboardCornersSB(region, self.corners, flags=flags)
        if not is_seen:
            return None
        pixels = np.float64(exact.reshape(-1, 2)) + low
        H, _ = cv2.findHomography(self.target.points[:, :2], pixels)
        if H is None:
            return None
        plane = cv2.perspectiveTransform(self.target.points[None, :, :2], H)[0]
        off = float(np.linalg.norm(plane - pixels, axis=-1).max())
        if off > _MAX_DEVIATION * min(step.min() for step in steps):
            return None
        return pixels.reshape(corners.shape)

    def _order_as_board(self, grey: np.ndarray, corners: np.ndarray) -> np.ndarray:
        """Order the corners (rows, columns, 2) as on the board.

        Columns run to the right of the rows, and the first square is dark if that distinguishes it
        from the last.
        """
        along, down = corners[0, -1] - corners[0, 0], corners[-1, 0] - corners[0, 0]
        if along[0] * down[1] - along[1] * down[0] < 0:
            corners = corners[:, ::-1]
        if len(self.target.orders) == 1 and _brightness(grey, corners) > _brightness(
            grey, corners[::-1, ::-1]
        ):
            corners = corners[::-1, ::-1]
        return corners

    def describe_search(self) -> str:
        """Return what is searched for, and what may differ."""
        columns, rows = self.corners
        return (
            f"searched for {columns}x{rows} inner corners, all of them in the picture (--squares "
            "counts squares)"
        )

    def describe_other_board(self, picture: np.ndarray) -> str | None:
        """Return which other chessboard the picture shows, None for none."""
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_LARGER
        is_seen, _, meta = cv2.findChessboardCornersSBWithMeta(to_grey(picture), (3, 3), flags)
        if not is_seen or meta is None:
            return None
        columns, rows = sorted((meta.shape[1] + 1, meta.shape[0] + 1), reverse=True)
        if (columns, rows) == tuple(sorted((c + 1 for c in self.corners), reverse=True)):
            return None
        return f"a chessboard of {columns}x{rows} squares"


def _brightness(grey: np.ndarray, corners: np.ndarray) -> float:
    """Return the grey level in the middle of the first square between corners (rows, columns,
    2)."""
    x, y = corners[:2, :2].reshape(4, 2).mean(axis=0).round().astype(int)
    patch = grey[max(0, y - 1) : y + 2, max(0, x - 1) : x + 2]
    return float(patch.mean()) if patch.size else 0.0


class CharucoFinder:
    """Detector of the inner corners of a ChArUco board (cv2.aruco.CharucoDetector).

    dictionary: a name of `DICTIONARIES`, or "auto": the first that is detected. first: number of
    the board's first marker. Boards made by OpenCV before 4.6, and boards printed white on black,
    are detected, too.
    """

    def __init__(
        self, squares: tuple[int, int], square: float, marker: float, dictionary: str = "auto",
        first: int = 0,
    ) -> None:  # fmt: skip
        check_squares(squares, square)
        check_number("marker (m)", marker, 0.0005, 0.999 * square)
        names = DICTIONARIES if dictionary == "auto" else (dictionary,)
        self.squares, self._names = squares, names
        needed = first + squares[0] * squares[1] // 2
        # Old and new boards differ if the number of rows is even.
        self._boards = [
            _make_charuco(squares, (square, marker), name, old, first)
            for name in names
            if first == 0 or len(choose_dictionary(name, needed).bytesList) >= needed
            for old in ((False, True) if squares[1] % 2 == 0 else (False,))
        ]
        if not self._boards:
            raise InputError(
                f"markers from number {first} on; {dictionary} has fewer: expected fewer boards or "
                "another --dictionary"
            )
        #: Detectors, and whether black and white are exchanged before.
        self._detectors = [
            (cv2.aruco.CharucoDetector(board), inverted)
            for inverted in (False, True)
            for board in self._boards
        ]
        points = np.asarray(self._boards[0].getChessboardCorners(), np.float64)
        name = f"ChArUco board of {squares[0]}x{squares[1]} squares"
        self.target = Target(name, points, np.arange(len(points))[None])

    def __call__(self, view: int, picture: np.ndarray) -> Found | None:
        """Return ids (N,) and pixels (N, 2) of the target's points; None if it is not seen."""
        grey = to_grey(picture)
        for detector, inverted in self._detectors:
            corners, ids, *_ = detector.detectBoard(255 - grey if inverted else grey)
            if ids is None or len(ids) < _CORNERS:
                continue
            ids = ids.ravel()
            rows, columns = np.divmod(ids, self.squares[0] - 1)
            if min(len(set(rows)), len(set(columns))) >= _LINES:
                self._detectors = [(detector, inverted)]  # the others detect other boards
                return ids, np.asarray(corners, np.float64).reshape(-1, 2)
        return None

    def describe_search(self) -> str:
        """Return what is searched for, and what may differ."""
        return (
            f"searched for {_CORNERS} corners or more between markers of "
            f"{join_names(self._names)}, black on white and white on black, of OpenCV's old "
            "pattern and the new one (--squares counts squares, columns first)"
        )

    def describe_other_board(self, picture: np.ndarray) -> str | None:
        """Describe the markers of another board in the picture, None for none."""
        grey = to_grey(picture)
        best: tuple[int, str] | None = None
        for name in DICTIONARIES:
            dictionary = choose_dictionary(name, 250)
            _, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(grey)
            if ids is not None and len(ids) > 3 and (best is None or len(ids) > best[0]):
                best = len(ids), f"{len(ids)} {name} markers with numbers up to {ids.max()}"
        return best[1] if best else None


def _make_charuco(
    squares: tuple[int, int], sides: tuple[float, float], name: str, old: bool, first: int
) -> Any:
    """Make a board of squares and markers with these sides, m."""
    count = squares[0] * squares[1] // 2
    dictionary = choose_dictionary(name, first + count)
    ids = np.arange(first, first + count) if first else None
    board = cv2.aruco.CharucoBoard(squares, *sides, dictionary, ids)
    board.setLegacyPattern(old)
    return board


def choose_dictionary(name: str, markers: int) -> Any:
    """Return the smallest set of a family with so many markers, or its largest."""
    dictionary: object = None
    for known in DICTIONARIES[name]:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, known))
        if len(dictionary.bytesList) >= markers:
            break
    return dictionary
