"""Boards: detection of rendered ones, hints of others, and pages to print."""

import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import calibration as made
from helpers.commands import fail, succeed

from cl import InputError
from psfs.calibration.intrinsics import read_intrinsics
from psfs.calibration.scene import rigid_transform
from psfs.calibration.targets.board_files import read_board
from psfs.calibration.targets.boards import CharucoFinder, ChessboardFinder
from psfs.calibration.targets.markers import find_bright_spots
from psfs.calibration.targets.print_board import list_black_squares
from psfs.cameras.camera import CameraRig

SQUARES, SQUARE = (6, 5), 0.18
CAMERA = made.ring(step=28)[1]


def chequered(squares: tuple[int, int]) -> np.ndarray:
    columns, rows = np.meshgrid(np.arange(30 * squares[0]), np.arange(30 * squares[1]))
    return np.where((columns // 30 + rows // 30) % 2, 255, 0).astype(np.uint8)


def pictured(render: Callable[..., np.ndarray], pose: np.ndarray, seed: int = 0) -> np.ndarray:
    grey = render(CAMERA, pose, np.random.default_rng(seed))
    return cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)


def test_a_chessboards_corners_are_found_in_their_order() -> None:
    """Upside down: with 5 x 4 inner corners the board's two ends differ in colour."""
    render = made.board_picture(chequered(SQUARES), SQUARE, SQUARES)
    rng = np.random.default_rng(3)
    pose = made.facing(rng, CAMERA.centre, reach=0.2)
    pose[:3, :3] = pose[:3, :3] @ np.diag([-1, -1, 1])
    finder = ChessboardFinder(SQUARES, SQUARE)
    assert len(finder.target.orders) == 1
    found = finder(0, pictured(render, pose))
    assert found is not None
    # The target's origin is the first inner corner, the picture's its outer one.
    points = finder.target.points[found[0]] + [SQUARE, SQUARE, 0]
    true, _ = CAMERA.project(points @ pose[:3, :3].T + pose[:3, 3])
    assert np.linalg.norm(found[1] - true, axis=1).max() < 0.5
    other = ChessboardFinder((5, 8), SQUARE)
    picture = pictured(render, pose)
    assert (
        other(0, picture) is None
        and other.describe_other_board(picture) == "a chessboard of 6x5 squares"
    )
    with pytest.raises(InputError, match="4x3 squares; expected 4 or more each way"):
        ChessboardFinder((4, 3), SQUARE)


def test_a_board_in_part_is_of_use_only_if_it_tells_its_numbers() -> None:
    """The ChArUco board is printed white on black."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_250)
    board = cv2.aruco.CharucoBoard(SQUARES, SQUARE, 0.14, dictionary)
    flat = board.generateImage((100 * SQUARES[0], 100 * SQUARES[1]))
    near = rigid_transform(CAMERA.R.T, CAMERA.centre + CAMERA.R.T @ [-0.55, -0.05, 1.0])
    finder = CharucoFinder(SQUARES, SQUARE, 0.14)
    found = finder(0, pictured(made.board_picture(255 - flat, SQUARE, SQUARES), near))
    assert found is not None and 6 <= len(found[0]) < 20
    true, _ = CAMERA.project(finder.target.points[found[0]] @ near[:3, :3].T + near[:3, 3])
    assert np.linalg.norm(found[1] - true, axis=1).mean() < 0.3
    chess = pictured(made.board_picture(chequered(SQUARES), SQUARE, SQUARES), near)
    assert ChessboardFinder(SQUARES, SQUARE)(0, chess) is None


def test_old_patterns_and_several_boards_are_told_apart(tmp_path: Path) -> None:
    """Two boards of one kind, numbered on, and OpenCV's pattern of before 4.6."""
    squares = (6, 4)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    near = rigid_transform(CAMERA.R.T, CAMERA.centre + CAMERA.R.T @ [-0.55, -0.4, 1.3])
    finders = [CharucoFinder(squares, SQUARE, 0.14, "4X4", first) for first in (0, 12)]
    for first, old in ((0, True), (12, False)):
        ids = np.arange(first, first + 12)
        board = cv2.aruco.CharucoBoard(squares, SQUARE, 0.14, dictionary, ids)
        board.setLegacyPattern(old)
        flat = board.generateImage((100 * squares[0], 100 * squares[1]))
        picture = pictured(made.board_picture(flat, SQUARE, squares), near)
        found = [finder(0, picture) for finder in finders]
        shown = found[first // 12]
        assert shown is not None and found[1 - first // 12] is None
        true, _ = CAMERA.project(finders[0].target.points[shown[0]] @ near[:3, :3].T + near[:3, 3])
        assert np.linalg.norm(shown[1] - true, axis=1).mean() < 0.3
    with pytest.raises(InputError, match="APRILTAG_36h11 has fewer"):
        CharucoFinder((40, 40), SQUARE, 0.14, "APRILTAG_36h11", 800)


CALISCOPE = """columns = 4
rows = 5
board_height = 11.0
board_width = 8.5
dictionary = "DICT_4X4_1000"
units = "inch"
aruco_scale = 0.75
inverted = true
"""
POSE2SIM = """[calibration.calculate.intrinsics]
intrinsics_corners_nb = [4, 7]
intrinsics_square_size = 60
"""
OPENCV = """<?xml version="1.0"?>
<opencv_storage><Settings><BoardSize_Width>{}</BoardSize_Width><BoardSize_Height>6</BoardSize_Height>
<Square_Size>50</Square_Size><Marker_Size>25</Marker_Size>
<Calibrate_Pattern>"{}"</Calibrate_Pattern><ArUco_Dict_Name>DICT_5X5_100</ArUco_Dict_Name>
</Settings></opencv_storage>"""


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("a.toml", CALISCOPE, ("charuco", (4, 5), 0.0254 * 2.125, 0.0254 * 1.59375, "4X4")),
        ("a.toml", CALISCOPE + "square_size_override_cm = 5.4", ("charuco", (4, 5), 0.054, 0.0405,
                                                                 "4X4")),
        ("b.toml", POSE2SIM, ("chessboard", (8, 5), 0.06, None, "auto")),
        ("c.xml", OPENCV.format(9, "CHESSBOARD"), ("chessboard", (10, 7), 0.05, None, "auto")),
        ("c.xml", OPENCV.format(9, "CHARUCOBOARD"), ("charuco", (9, 6), 0.05, 0.025, "5X5")),
    ],
)  # fmt: skip
def test_boards_of_other_programs(tmp_path: Path, name: str, text: str, expected: tuple) -> None:
    (tmp_path / name).write_text(text)
    found = read_board(tmp_path / name)
    assert (found.kind, found.squares, found.dictionary) == (*expected[:2], expected[4])
    np.testing.assert_allclose(found.square, expected[2])
    assert found.marker == (None if expected[3] is None else pytest.approx(expected[3]))


@pytest.mark.parametrize(
    ("name", "text"),
    [("a.toml", "x = 1"), ("b.toml", CALISCOPE.replace("4X4_1000", "9X9")), ("c.yml", "a: 1"),
     ("d.xml", "<"), ("e.toml", CALISCOPE.replace("inch", "mile"))],
)  # fmt: skip
def test_files_without_a_board_are_named(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=rf"{name}: .*expected"):
        read_board(tmp_path / name)


def test_spots_are_found_to_a_fraction_of_a_pixel() -> None:
    rows, columns = np.mgrid[:60, :80]
    spots = np.array([[20.3, 30.6], [55.75, 12.2]])
    image = sum(200 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / 5) for x, y in spots)
    found = find_bright_spots(np.rint(image).astype(np.uint8))
    np.testing.assert_allclose(found[found[:, 0].argsort()], spots, atol=0.05)
    assert len(find_bright_spots(np.full((60, 80), 20, np.uint8))) == 0
    corners = np.zeros((60, 80), np.uint8)
    corners[:3, :3] = corners[-3:, -3:] = 200
    np.testing.assert_allclose(find_bright_spots(corners), [[1, 1], [78, 58]])


def test_lenses_come_from_pictures_of_a_board_alone(tmp_path: Path) -> None:
    render = made.board_picture(chequered(SQUARES), SQUARE, SQUARES)
    rng = np.random.default_rng(4)
    poses = [made.facing(rng, CAMERA.centre + rng.normal(0, 1.2, 3), 0.4) for _ in range(12)]
    made.film(tmp_path, [CAMERA], poses, render)
    rig, finder = CameraRig((CAMERA,)), ChessboardFinder(SQUARES, SQUARE)
    (found,) = read_intrinsics(tmp_path / "images", rig, finder)
    assert found.name == CAMERA.name and abs(found.K[0, 0] / CAMERA.K[0, 0] - 1) < 0.02
    assert found.t.tolist() == [0, 0, 0]
    with pytest.raises(InputError, match="can be used with --board only"):
        read_intrinsics(tmp_path / "images", rig, None)


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


def test_a_page_in_its_true_size(tmp_path: Path) -> None:
    path = tmp_path / "board.pdf"
    assert "print it at 100 %" in succeed("psfs", "calibrate", "--print-board", path).out
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
def test_impossible_boards(tmp_path: Path, flags: list[str], message: str) -> None:
    path = tmp_path / "board.pdf"
    said = fail("psfs", "calibrate", "--print-board", path, *flags)
    assert message in said and not path.exists()
