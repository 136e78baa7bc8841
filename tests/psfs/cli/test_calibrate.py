"""`psfs calibrate` on rendered boards and wands: from pictures to calibration.toml."""

import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from helpers import calibration as made
from helpers.commands import fail, succeed
from helpers.footage import write_c3d
from PIL import Image

from psfs.calibration.pictures import write_view
from psfs.cameras.calibration import read_calibration
from psfs.cameras.calibration.toml_tables import write_toml_tables
from psfs.cameras.camera import Camera, CameraRig

#: All around a wand; side by side for a board, which has one face.
CAMERAS, ARC = made.ring()[:4], made.ring(4, step=28)
SQUARES, SQUARE, WAND = (6, 4), 0.2, 0.5
BOARD_FLAGS = ("--squares", "6x4", "--square", "0.2")


@pytest.fixture(scope="module")
def boards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ChArUco board: frame 0 on the floor, then towards the cameras in turn; lens.toml."""
    folder = tmp_path_factory.mktemp("calibrate") / "boards"
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard(SQUARES, SQUARE, 0.15, dictionary)
    picture = board.generateImage((60 * SQUARES[0], 60 * SQUARES[1]))
    rng = np.random.default_rng(1)
    poses = [made.flat(0.0, -0.2, 0.9)]
    poses += [made.facing(rng, ARC[k % 4].centre) for k in range(18)]
    made.film(folder, ARC, poses, made.board_picture(picture, SQUARE, SQUARES))
    return with_lenses(folder, ARC)


@pytest.fixture(scope="module")
def wands(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wand of two markers, and where they were: wand.c3d, 2 frames per picture;
    lens.toml."""
    folder = tmp_path_factory.mktemp("calibrate") / "wands"
    points, rng = np.array([[0, 0, 0], [WAND, 0, 0]]), np.random.default_rng(2)
    poses = [made.flat(0.0), made.flat(1.5, 0.4), *(made.anyhow(rng) for _ in range(50))]
    made.film(folder, CAMERAS, poses, made.wand_picture(points))
    places = np.stack([points @ pose[:3, :3].T + pose[:3, 3] for pose in poses])
    places = np.repeat(1000 * places, 2, axis=0)
    write_c3d(folder / "wand.c3d", places, ("near", "far"), 60.0)
    return with_lenses(folder, CAMERAS)


def with_lenses(folder: Path, cameras: list[Camera]) -> Path:
    write_toml_tables(folder / "lens.toml", CameraRig(tuple(made.unplaced(cameras))))
    return folder


def calibrate(folder: Path, out: Path, *flags: str) -> list[str]:
    return ["psfs", "calibrate", str(folder), "-o", str(out), *flags]


@pytest.fixture
def without_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """A second of CPU for each camera; the test of a board has them."""
    for name in ("write_view", "write_rig"):
        monkeypatch.setattr(f"psfs.cli.calibrate.{name}", lambda *_: None)


def test_board_with_known_lenses(
    boards: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write_first(path: Path, *more: Any) -> None:
        if path.stem == "cam01":  # half a second each
            write_view(path, *more)

    monkeypatch.setattr("psfs.cli.calibrate.write_view", write_first)
    out = tmp_path / "out"
    lenses = ("--intrinsics", str(boards / "lens.toml"), "--boards", "2")
    board = tmp_path / "charuco.toml"
    board.write_text(
        'columns = 6\nrows = 4\nsquare_size_override_cm = 20\ndictionary = "DICT_4X4_50"\n'
    )
    succeed(*calibrate(boards, out, "--board", str(board), "--floor", "0", *lenses))
    found = list(read_calibration(out / "calibration.toml"))
    away, scale = made.differences(found, ARC)
    assert away.max() < 6 and abs(scale) < 0.002
    # The first inner corner is above the origin, X along the board's upper edge, Z up.
    first = np.array([-0.2 + SQUARE, 0.9 - SQUARE, 0])
    for camera, true in zip(found, ARC, strict=True):
        np.testing.assert_allclose(camera.centre, true.centre - first, atol=0.04)
    report = json.loads((out / "calibration.json").read_text())
    assert all(of["reprojection_px"]["rms"] < 0.5 for of in report["cameras"].values())
    assert report["warnings"] == [] and "coverage" in report["cameras"]["cam01"]
    for name in ("rig.png", "cameras/cam01.png"):
        assert cv2.imread(str(out / name)).shape[1] > 1000


@pytest.mark.usefixtures("without_pictures")
def test_wand(wands: Path, tmp_path: Path) -> None:
    lenses = ("--intrinsics", str(wands / "lens.toml"))
    printed = succeed(*calibrate(wands, tmp_path, "--wand", "0.5", *lenses)).out
    found = list(read_calibration(tmp_path / "calibration.toml"))
    away, scale = made.differences(found, CAMERAS)
    assert away.max() < 6 and abs(scale) < 0.002
    report = json.loads((tmp_path / "calibration.json").read_text())
    assert all(of["reprojection_px"]["rms"] < 0.5 for of in report["cameras"].values())
    assert "no --floor is stated" in printed and "cam04" in printed
    assert min(camera.centre[2] for camera in found) > 1  # Z is up


@pytest.mark.usefixtures("without_pictures")
def test_measured_markers_give_cameras_in_their_frame(wands: Path, tmp_path: Path) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text(f'c3d = "{wands / "wand.c3d"}"\ncameras = "cam01,cam02,cam03"\n')
    succeed(*calibrate(wands, tmp_path / "out", "--config", str(settings)))
    found = read_calibration(tmp_path / "out" / "calibration.toml")
    for camera, true in zip(found, CAMERAS[:3], strict=True):
        np.testing.assert_allclose(camera.centre, true.centre, atol=0.02)
        assert abs(camera.K[0, 0] / true.K[0, 0] - 1) < 0.01


def test_what_cannot_be_is_one_line(boards: Path, wands: Path, tmp_path: Path) -> None:
    short = ("--frames", "1:3", "--cameras", "cam01,cam02")

    def line(folder: Path, *flags: str) -> str:
        error = fail(*calibrate(folder, tmp_path / "out", *flags)).strip().splitlines()
        assert not (tmp_path / "out").exists()
        return error[-1]

    two = ("--frames", "1:2", "--cameras", "cam01,cam02")
    large, wand = ("--squares", "12x9", "--square", "0.1"), ("--wand", "0.5")
    square = ("--squares", "6x6", "--square", "0.2")
    mocap = ("--c3d", str(wands / "wand.c3d"), "--markers", "near,middle")
    for folder, flags, said in (
        (boards, ("--board", "none.toml"), "expected charuco, chessboard, or a board's file"),
        (boards, ("--board", "charuco", *large, *two), "4X4 markers with numbers up to 11"),
        (boards, ("--board", "chessboard", *square), "looks alike from four sides"),
        (boards, ("--board", "chessboard"), "--board needs --squares"),
        (boards, (*wand, "--frames", "0:1"), "only bright spots"),
        (wands, (*wand, "--squares", "6x4"), "expected --board"),
        (wands, (*wand, "--frames", "2:8"), "together in 6 frames at most; expected 10"),
        (wands, (*wand, "--intrinsics", str(tmp_path / "none.toml")), "no such file"),
        (wands, (*wand, "--stature", "1.8"), "expected --person with it"),
        (wands, ("--wand", "500"), "wand (m) is 500"),
        (wands, mocap, "no marker middle"),
        (wands, ("--person", "--sync", "cam01=1"), "expected none with --person"),
    ):
        assert said in line(folder, *flags)
    missing = line(wands, "--board", "charuco", *BOARD_FLAGS, *short)
    assert "no ChArUco board of 6x4 squares in 2 frames of 2 cameras" in missing
    assert "searched for 6 corners or more between markers of 4X4, 5X5" in missing
    (tmp_path / "day" / "walk" / "videos").mkdir(parents=True)
    assert "as its folder walk has" in line(tmp_path / "day", "--person")
    silent = line(wands, "--person")
    assert "no lenses are stated" in silent and "no focal length in the metadata" in silent
    lenses = ("--intrinsics", str(wands / "lens.toml"))
    few = tmp_path / "few"
    left_out = shutil.ignore_patterns("*[1-9]?.pgm", "*[89].pgm", "cam04")
    shutil.copytree(wands / "images", few / "images", ignore=left_out)
    seldom = line(few, "--person", *lenses)
    assert "the whole person is in" in seldom and "film one person" in seldom
    photos = tmp_path / "photos"
    photos.mkdir()
    assert "no calibration and no photos" in line(wands, "--person", "--intrinsics", str(photos))
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 26
    for name in ("cam01", "cam02", "cam03"):
        Image.new("RGB", (40, 30)).save(photos / f"{name}.jpg", exif=exif)
    assert "the whole person is in" in line(few, "--person", "--intrinsics", str(photos))
    photo = str(photos / "cam01.jpg")
    assert "a folder with a photo" in line(wands, "--person", "--intrinsics", photo)
