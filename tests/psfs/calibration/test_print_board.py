"""The printed board is OpenCV's, in its true size, and is found again."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from psfs.calibration.targets.boards import CharucoFinder
from psfs.calibration.targets.print_board import list_black_squares
from psfs.cli import main

MARKERS = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)


def draw(squares: tuple[int, int], side: int, inner: int) -> np.ndarray:
    """The board's black squares as a picture of one pixel per millimetre."""
    picture = np.full((squares[1] * side, squares[0] * side), 255, np.uint8)
    for left, top, across in list_black_squares(squares, side, inner, MARKERS):
        x, y, n = round(left), round(top), round(across)
        picture[y : y + n, x : x + n] = 0
    return picture


@pytest.mark.parametrize("squares", [(7, 5), (6, 4)])
def test_the_board_is_opencvs(squares: tuple[int, int]) -> None:
    found = draw(squares, 80, 60)
    board = cv2.aruco.CharucoBoard(squares, 0.08, 0.06, MARKERS)
    expected = board.generateImage((80 * squares[0], 80 * squares[1]))
    np.testing.assert_array_equal(found > 127, expected > 127)
    shown = cv2.cvtColor(cv2.copyMakeBorder(found, *4 * [40], cv2.BORDER_CONSTANT, value=255), 8)
    seen = CharucoFinder(squares, 0.08, 0.06, "auto")(0, shown)
    assert seen is not None and len(seen[0]) == (squares[0] - 1) * (squares[1] - 1)


def test_a_page_in_its_true_size(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "board.pdf"
    assert main(["calibrate", "--print-board", str(path)]) == 0
    assert "print it at 100 %" in capsys.readouterr().out
    box = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+)", path.read_bytes())
    assert box is not None
    page = np.array([float(n) for n in box.groups()]) / 72 * 25.4
    np.testing.assert_allclose(page, [7 * 37 + 20, 5 * 37 + 32], atol=0.1)
    assert page[0] <= 297 and page[1] <= 230


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--squares", "60x60"], "choose another --dictionary"),
        (["--marker", "0.05"], "smaller than the squares"),
        (["--wand", "0.5"], "expected none with --print-board"),
        (["--square", "3"], "at most"),
        (["--squares", "2x2"], "expected 3x3 or more"),
        (["--square", "1e-6"], "markers of 1 mm or more"),
    ],
)
def test_impossible_boards(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], flags: list[str], message: str
) -> None:
    path = tmp_path / "board.pdf"
    code = main(["calibrate", "--print-board", str(path), *flags])
    said = capsys.readouterr().err
    assert code == 2 and message in said and not path.exists()
