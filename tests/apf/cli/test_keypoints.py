"""`apf keypoints`, with MediaPipe itself where it is installed, else with a package that stands for
it: it finds the person where the picture is brightest."""

import json
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from helpers import footage
from helpers.commands import fail, succeed
from helpers.shared import shared_data

import psfs
from apf.keypoints.keypoints import Keypoints
from apf.keypoints.readers.orders import MEDIAPIPE
from psfs.cameras.camera import CameraRig
from psfs.common.files import write_text
from psfs.common.outputs import output_folder
from psfs.people.people import StandingPeople

FRAMES = 6
STAND_IN = '''
"""Stands for MediaPipe: 33 landmarks around the middle of what is bright."""
from pathlib import Path
from types import SimpleNamespace
import numpy as np

class Pose:
    def __init__(self, static_image_mode, model_complexity):
        self.shapes = []
    def process(self, rgb):
        with (Path(__file__).parent / "seen.txt").open("a") as file:
            file.write("%d %d\\n" % rgb.shape[:2])
        rows, columns = np.nonzero(rgb.min(-1) > 200)
        if not rows.size:
            return SimpleNamespace(pose_landmarks=None)
        height, width = rgb.shape[:2]
        x, y = (columns.mean() + 0.5) / width, (rows.mean() + 0.5) / height
        one = SimpleNamespace(x=x, y=y, visibility=0.9)
        return SimpleNamespace(pose_landmarks=SimpleNamespace(landmark=[one] * 33))
    def reset(self):
        with (Path(__file__).parent / "seen.txt").open("a") as file:
            file.write("reset\\n")
    def close(self):
        pass
'''


@pytest.fixture
def stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file in which it says what it was shown; `mediapipe` is on the path, of processes too."""
    solutions = tmp_path / "packages" / "mediapipe" / "python" / "solutions"
    solutions.mkdir(parents=True)
    for folder in (solutions, solutions.parent, solutions.parent.parent):
        (folder / "__init__.py").write_text("")
    (solutions / "pose.py").write_text(STAND_IN)
    for name in [name for name in sys.modules if name.split(".")[0] == "mediapipe"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(str(tmp_path / "packages"))
    return solutions / "seen.txt"


def left_of(frame: int) -> int:
    return 60 + 10 * frame + 200 * (frame > 3)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two cameras before which a small bright square moves; cam02 loses it in the last frame."""
    cameras = [replace(camera, size=(640, 480)) for camera in footage.rig(2)]
    pictures = np.full((2, FRAMES, 480, 640, 3), 60, np.uint8)
    for view, frame in np.ndindex(2, FRAMES):
        if not (view == 1 and frame == FRAMES - 1):
            left = left_of(frame)
            pictures[view, frame, 100 : 160 + 40 * view, left : left + 40] = 250
    rooms = np.random.default_rng(0).integers(58, 63, (3, 48, 64, 3)).astype(np.uint8)
    for kind, views in (("images", pictures), ("background", 2 * [np.tile(rooms, (10, 10, 1))])):
        footage.write_take(tmp_path / "walk", CameraRig(tuple(cameras)), views, kind)
    folder = tmp_path / "walk"
    assert len(psfs.open_sequence(folder)) == FRAMES  # sizes are the pictures'
    return folder


def places() -> np.ndarray:
    """(2, F, 2) px, the middles of the squares; NaN where there is none."""
    middles = [[(left_of(k) + 19.5, 129.5 + 20 * v) for k in range(FRAMES)] for v in (0, 1)]
    middles[1][-1] = (np.nan, np.nan)
    return np.array(middles)


def test_keypoints_are_written_and_read_back(folder: Path, tmp_path: Path, stand_in: Path) -> None:
    out = tmp_path / "pose"
    said = succeed("apf", "keypoints", folder, "-o", out, "--at-once", "1").out
    assert f"{FRAMES} frames x 2 cameras" in said
    for camera in ("cam01", "cam02"):
        assert len(list(out.glob(f"{camera}_json/{camera}_00000[0-5].json"))) == FRAMES
    read = Keypoints.open(out, psfs.open_sequence(folder))
    assert read.names == MEDIAPIPE and read.notes == ()
    expected = np.tile(places()[:, :, None], (1, 1, 33, 1))
    np.testing.assert_allclose(read.points[..., :2], expected, atol=0.2)
    assert np.nanmax(np.abs(read.points[..., 2] - 0.9)) < 1e-3
    shown = [line.split() for line in stand_in.read_text().splitlines() if line != "reset"]
    sizes = np.array(shown, int)
    assert (np.median(sizes, axis=0) <= 200).all()  # cropped


def test_of_several_people_each_is_in_the_files(
    folder: Path, tmp_path: Path, stand_in: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One stands where the square is in the last frames but one, the other beside the picture."""
    camera = psfs.open_sequence(folder).rig[0]
    middle = camera.centre + 3 * camera.rays(places()[0, 2:3])[0]
    apart = np.array([middle, middle + 100])
    standing = StandingPeople(np.zeros(1, int), (apart / [1, 1, 0.67])[None])
    monkeypatch.setattr("apf.cli.keypoints._find_people", lambda *of: standing)
    out = tmp_path / "pose"
    command = ["keypoints", str(folder), "-o", str(out), "--people", "2", "--cameras", "cam01"]
    said = succeed("apf", *command).err
    assert "cam01: person 2 was found in 0 of 6 frames only" in said
    read = Keypoints.open(out, ["cam01"])
    np.testing.assert_allclose(read.points[0, 2, 0, :2], places()[0, 2], atol=0.2)


def test_whole_pictures_replace_older_ones(folder: Path, tmp_path: Path, stand_in: Path) -> None:
    out = tmp_path / "pose"
    older = out / "cam01_json" / "cam01_000099.json"
    with output_folder(out, "apf keypoints"):
        write_text(older, "of a longer video")
    succeed("apf", "keypoints", folder, "-o", out, "--no-crop", "--cameras", "cam01")
    assert set(stand_in.read_text().splitlines()) == {"480 640"}
    read = Keypoints.open(out, ["cam01"])
    assert read.n_frames == FRAMES and len(list(out.iterdir())) == 3
    np.testing.assert_allclose(read.points[0, :, 0, :2], places()[0], atol=0.2)


def test_bad_pictures_leave_no_half_files(folder: Path, tmp_path: Path, stand_in: Path) -> None:
    (folder / "images" / "cam02" / "0003.png").write_bytes(b"no picture")
    out = tmp_path / "pose"
    said = fail("apf", "keypoints", folder, "-o", out, "--at-once", "1", "--no-crop").splitlines()
    assert "0003.png" in said[-1] and "Traceback" not in "".join(said)
    names = sorted(path.name for path in out.iterdir())
    assert names == ["cam01_json", "manifest.txt"]
    assert len(list((out / "cam01_json").iterdir())) == FRAMES


def test_without_the_extra_one_line(
    folder: Path, tmp_path: Path, stand_in: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor with newer releases, which have no pose model."""
    command = ["apf", "keypoints", folder, "-o", tmp_path / "pose"]
    (stand_in.parent / "pose.py").unlink()
    newer = fail(*command)
    monkeypatch.setattr("apf.keypoints.network.find_spec", lambda name: None)
    absent = fail(*command)
    assert "carries no pose model" in newer and "which is not installed: pip install '" in absent
    assert newer.count("\n") == absent.count("\n") == 1 and not (tmp_path / "pose").exists()


@pytest.mark.skipif(find_spec("mediapipe") is None, reason="needs the extra keypoints")
def test_mediapipe_itself(tmp_path: Path) -> None:
    folder = shared_data("synth_box_4cam")
    out = tmp_path / "pose"
    succeed("apf", "keypoints", str(folder), "-o", str(out), "--cameras", "cam01")
    read, known = Keypoints.open(out, ["cam01"]), Keypoints.open(folder).select_cameras(["cam01"])
    away = np.hypot(*np.moveaxis((read.points - known.points)[0, :, 11:, :2], -1, 0))
    assert np.median(away) < 5
    people = json.loads((out / "cam01_json" / "cam01_000000.json").read_text())["people"]
    assert len(people) == 1
