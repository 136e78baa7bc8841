"""The page calibrates cameras: what the board has covered, what is missing, the cameras' use."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import calibration as made
from helpers.waiting import wait_for

pytest.importorskip("viser", reason="viser is not installed")

from apf.live.cameras import Captures
from apf.studio.calibrate import CalibrateView
from apf.studio.film import PERSON as PERSON_LIVE
from apf.studio.film import TARGET, FilmView, PersonCheck
from apf.studio.folders import Roots, find_kind
from apf.studio.footage import FootageView
from apf.studio.page import Page
from apf.studio.target_fields import CHARUCO, CHESSBOARD, PERSON, WAND
from cl import Device, InputError
from psfs.calibration.targets.detection import open_uncalibrated
from psfs.footage.settings import SequenceSettings
from psfs.output.video import write_video
from psfs.sequence import Frame, Sequence

SQUARES, SQUARE = (6, 4), 0.2
CAMERAS = made.ring(step=28)[:3]


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Views of a board, and of somebody else, without a calibration."""
    folder = tmp_path_factory.mktemp("day")
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard(SQUARES, SQUARE, 0.15, dictionary)
    picture = board.generateImage((60 * SQUARES[0], 60 * SQUARES[1]))
    rng = np.random.default_rng(1)
    poses = [made.facing(rng, CAMERAS[k % 3].centre) for k in range(12)]
    made.film(folder / "board", CAMERAS, poses, made.board_picture(picture, SQUARE, SQUARES))
    shutil.copytree(folder / "board", folder / "walk")
    return folder


def write_frames(path: Path, frames: list[np.ndarray]) -> None:
    path.parent.mkdir(exist_ok=True)
    with write_video(path, 30.0) as video:
        for frame in frames:
            video.write(frame)


def no_device() -> Device:
    raise InputError("nothing here is examined")


@pytest.fixture
def page(day: Path, tmp_path: Path) -> Iterator[Page]:
    page = Page(Roots(day), no_device, results=tmp_path / "results")
    yield page
    page.stop()


def test_board_is_found_and_cameras_are_used(day: Path, page: Page) -> None:
    for name in ("anna", "ben"):
        write_frames(day / "phones" / f"{name}.mp4", 3 * [np.zeros((60, 80, 3), np.uint8)])
    assert find_kind(day / "board") == find_kind(day / "phones") == "views"
    page.open(day / "phones")
    assert isinstance(page.view, CalibrateView) and page.view.views.rig.names == ["anna", "ben"]
    page.open(day / "board")
    view = page.view
    view.target.kind.value = CHARUCO
    view.target.squares.value, view.target.square.value = SQUARES, SQUARE
    view.search()
    view._worker.join(600)
    assert "looked at all frames" in view.words.content and "cam" in view.words.content
    assert all(seen.frames >= 5 for seen in view.target.coverage)
    view.calibrate()
    view.slot.wait(600)
    assert view.slot.work.succeeded, view.slot.work.words
    page.open(day / "walk")
    assert view.cameras.value in page.view.cameras.options
    page.view.cameras.value = view.cameras.value
    page.view.use()
    assert isinstance(page.view, FootageView)
    assert page.view.sequence.rig.names == [camera.name for camera in CAMERAS]
    assert str(page.run.make_request().capture.calibration).endswith("calibration.toml")


def test_board_is_found_live(day: Path, tmp_path: Path) -> None:
    views = open_uncalibrated(day / "board", SequenceSettings())
    frames = [views.read(index) for index in range(len(views))]
    paths = [tmp_path / f"{name}.mp4" for name in "abc"]
    for view, path in enumerate(paths):
        write_frames(path, [frame.images[view] for frame in frames])
    captures = Captures([str(path) for path in paths])
    captures.record(tmp_path / "first" / "videos", ["a", "b", "c"])
    page = Page(Roots(day), no_device, results=tmp_path / "results", captures=captures)
    try:
        page.open_cameras()
        film = page.view
        assert isinstance(film, FilmView)
        wait_for(lambda: captures.ended)
        assert "has ended" in captures.ended
        assert captures.stop_recording() > 5
        assert find_kind(tmp_path / "first") == "views"
        film.target.squares.value, film.target.square.value = SQUARES, SQUARE
        film.mode.value = TARGET
        for frame in frames:
            film.examine_frame(frame)
        assert "covered" in film.words.content and "expected 12 or more" in film.words.content
        n_found = len(film.target.sightings)
        film.examine_frame(frames[-1])  # it has not moved
        assert n_found == len(film.target.sightings) > 15
        film.mode.value = PERSON_LIVE
        assert "nobody in the pictures" in film.words.content or film.person is None
    finally:
        page.stop()


def test_person_who_walks_in_is_judged(small_walk: Path) -> None:
    sequence = Sequence.open(small_walk)
    empty = np.rint(sequence.background.mean).astype(np.uint8)
    noise = np.random.default_rng(0).integers(-2, 3, (5, *empty.shape))
    rooms = list((empty + noise).clip(0, 255).astype(np.uint8))
    check = PersonCheck(Device.best(), sequence.rig, rooms)
    assert all(0.01 < mask.mean() < 0.3 for mask in check.examine_frame(sequence.read(2)))
    assert all(one.seen == 1 and one.height > 30 for one in check.views)
    assert "whole" in check.describe() and "px high" in check.describe()
    check.examine_frame(Frame(9, empty, None))
    assert all(one.seen == 1 for one in check.views)  # an empty room is nobody's fault
    alone = PersonCheck(Device.best(), sequence.rig, [empty])
    alone.examine_frame(Frame(9, empty, None))
    assert "nobody is seen yet" in alone.describe()


def test_fields_are_the_request_of_calibrate(day: Path, page: Page) -> None:
    page.open(day / "board")
    fields = page.view.target
    fields.kind.value = CHARUCO
    assert fields.stated() == {"board": "charuco", "squares": (7, 5), "square": 0.037}
    name, content = fields.make_board()
    assert name == "board_7x5_37mm.pdf" and content.startswith(b"%PDF")
    fields.kind.value = CHESSBOARD
    assert fields.stated()["board"] == "chessboard" and not fields.wand.visible
    fields.kind.value = PERSON
    assert fields.stated() == {"person": True, "stature": 1.7, "field_of_view": 65.0}
    assert not fields.searchable and not page.view.search_button.visible
    fields.kind.value, fields.wand.value = WAND, "0.2,0.3"
    assert fields.stated() == {"wand": (0.2, 0.3)}
    fields.wand.value = "long"
    with pytest.raises(InputError, match="expected metres"):
        fields.stated()
