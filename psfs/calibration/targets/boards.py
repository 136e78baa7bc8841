"""Finding boards in pictures, by OpenCV's detectors."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from cl import InputError
from psfs.calibration.targets.dictionaries import DICTIONARIES
from psfs.calibration.targets.target import Target, check_squares, chessboard
from psfs.cameras.names import listed
from psfs.common.ranges import check_number

#: Corners of a ChArUco board that tell its pose, and rows and columns that they must cover.
_CORNERS, _LINES = 6, 2
#: Of a square, how far corners may lie off their plane's picture, which lenses bend.
_BENT = 0.3

Found = tuple[np.ndarray, np.ndarray]


def grey_of(picture: np.ndarray) -> np.ndarray:
    """Return (h, w) uint8 of a BGR picture."""
    grey: np.ndarray = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    return grey


class ChessboardFinder:
    """Finds all inner corners of a chessboard: cv2.findChessboardCorners finds the board, which is
    soon done; cv2.findChessboardCornersSB then looks at that part only, and is the more exact."""

    def __init__(self, squares: tuple[int, int], square: float) -> None:
        self.target = chessboard(squares, square)
        self.corners = squares[0] - 1, squares[1] - 1

    def __call__(self, view: int, picture: np.ndarray) -> Found | None:
        """Return ids (N,) and pixels (N, 2) of the target's points; None where it is not seen."""
        grey = grey_of(picture)
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        flags |= cv2.CALIB_CB_FAST_CHECK
        found, corners = cv2.findChessboardCorners(grey, self.corners, flags=flags)
        if not found:
            return None
        exact = self._exact(grey, corners.reshape(*self.corners[::-1], 2))
        if exact is None:
            return None
        return np.arange(len(self.target.points)), self._ordered(grey, exact).reshape(-1, 2)

    def _exact(self, grey: np.ndarray, corners: np.ndarray) -> np.ndarray | None:
        """Return the corners (rows, columns, 2) to a fraction of a pixel; None where they are not
        those of a plane, as corners that were made up behind the picture's edge."""
        steps = [np.linalg.norm(np.diff(corners, axis=axis), axis=-1) for axis in (0, 1)]
        margin = 2 * max(step.max() for step in steps)
        low = np.maximum(corners.min(axis=(0, 1)) - margin, 0).astype(int)
        high = (corners.max(axis=(0, 1)) + margin).astype(int) + 1
        part = grey[low[1] : high[1], low[0] : high[0]]
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
        found, exact = cv2.findChessboardCornersSB(part, self.corners, flags=flags)
        if not found:
            return None
        pixels = np.float64(exact.reshape(-1, 2)) + low
        H, _ = cv2.findHomography(self.target.points[:, :2], pixels)
        if H is None:
            return None
        plane = cv2.perspectiveTransform(self.target.points[None, :, :2], H)[0]
        off = float(np.linalg.norm(plane - pixels, axis=-1).max())
        if off > _BENT * min(step.min() for step in steps):
            return None
        return pixels.reshape(corners.shape)

    def _ordered(self, grey: np.ndarray, corners: np.ndarray) -> np.ndarray:
        """Return corners (rows, columns, 2) whose columns run to the right of its rows as on the
        board, and whose first square is dark where that is told from the last."""
        along, down = corners[0, -1] - corners[0, 0], corners[-1, 0] - corners[0, 0]
        if along[0] * down[1] - along[1] * down[0] < 0:
            corners = corners[:, ::-1]
        if len(self.target.orders) == 1 and _brightness(grey, corners) > _brightness(
            grey, corners[::-1, ::-1]
        ):
            corners = corners[::-1, ::-1]
        return corners

    def hint(self, picture: np.ndarray) -> str | None:
        """Return what the picture shows instead, if that is another chessboard."""
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_LARGER
        found, _, meta = cv2.findChessboardCornersSBWithMeta(grey_of(picture), (3, 3), flags)
        if not found or meta is None:
            return None
        columns, rows = sorted((meta.shape[1] + 1, meta.shape[0] + 1), reverse=True)
        if (columns, rows) == tuple(sorted((c + 1 for c in self.corners), reverse=True)):
            return None
        return f"a chessboard of {columns}x{rows} squares"


def _brightness(grey: np.ndarray, corners: np.ndarray) -> float:
    """Return the grey level amid the first square between corners (rows, columns, 2)."""
    x, y = corners[:2, :2].reshape(4, 2).mean(axis=0).round().astype(int)
    patch = grey[max(0, y - 1) : y + 2, max(0, x - 1) : x + 2]
    return float(patch.mean()) if patch.size else 0.0


class CharucoFinder:
    """Finds the inner corners of a ChArUco board, cv2.aruco.CharucoDetector.

    dictionary: a name of `DICTIONARIES`, or "auto": the first that is seen. Boards made by OpenCV
    before 4.6 are taken, too.
    """

    def __init__(
        self, squares: tuple[int, int], square: float, marker: float, dictionary: str = "auto"
    ) -> None:
        check_squares(squares, square)
        check_number("marker (m)", marker, 0.0005, 0.999 * square)
        if dictionary not in ("auto", *DICTIONARIES):
            raise InputError(f"dictionary {dictionary!r}; expected auto, {listed(DICTIONARIES)}")
        names = DICTIONARIES if dictionary == "auto" else (dictionary,)
        self.squares = squares
        # Old and new boards differ where the number of rows is even.
        self._boards = [
            _charuco(squares, square, marker, name, old)
            for name in names
            for old in ((False, True) if squares[1] % 2 == 0 else (False,))
        ]
        self._detectors = [cv2.aruco.CharucoDetector(board) for board in self._boards]
        points = np.asarray(self._boards[0].getChessboardCorners(), np.float64)
        name = f"ChArUco board of {squares[0]}x{squares[1]} squares"
        self.target = Target(name, points, np.arange(len(points))[None])

    def __call__(self, view: int, picture: np.ndarray) -> Found | None:
        """Return ids (N,) and pixels (N, 2) of the target's points; None where it is not seen."""
        grey = grey_of(picture)
        for detector in self._detectors:
            corners, ids, *_ = detector.detectBoard(grey)
            if ids is None or len(ids) < _CORNERS:
                continue
            ids = ids.ravel()
            rows, columns = np.divmod(ids, self.squares[0] - 1)
            if min(len(set(rows)), len(set(columns))) >= _LINES:
                self._detectors = [detector]  # the others are of other boards
                return ids, np.float64(corners.reshape(-1, 2))
        return None

    def hint(self, picture: np.ndarray) -> str | None:
        """Return what the picture shows instead, if that is markers of another board."""
        grey = grey_of(picture)
        best: tuple[int, str] | None = None
        for name in DICTIONARIES:
            dictionary = _dictionary(name, 250)
            _, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(grey)
            if ids is not None and len(ids) > 3 and (best is None or len(ids) > best[0]):
                best = len(ids), f"{len(ids)} {name} markers with numbers up to {ids.max()}"
        return best[1] if best else None


def _charuco(squares: tuple[int, int], square: float, marker: float, name: str, old: bool) -> Any:
    dictionary = _dictionary(name, squares[0] * squares[1] // 2)
    board = cv2.aruco.CharucoBoard(squares, square, marker, dictionary)
    board.setLegacyPattern(old)
    return board


def _dictionary(name: str, markers: int) -> Any:
    """Return the smallest set of a family that has so many markers, its largest if none has."""
    found: Any = None
    for known in DICTIONARIES[name]:
        found = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, known))
        if len(found.bytesList) >= markers:
            break
    return found
