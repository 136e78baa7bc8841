"""Videos and pictures that break while they are read."""

import os
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import footage
from helpers.commands import run_python
from helpers.footage import cut

from cl import InputError
from psfs.sequence import Sequence


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    return footage.native(tmp_path / "walk", frames=40)


def test_no_noise_from_the_decoders(walk: Path) -> None:
    """Runs in its own process, where FFmpeg was not muted before psfs is imported."""
    cut(walk / "videos/cam02.mp4", 0.5)
    unmuted = dict.fromkeys(name for name in os.environ if name.startswith("OPENCV"))
    result = run_python("-m", "psfs.cli", "info", walk, **unmuted)
    assert result.code == 2 and result.out == ""
    assert result.err.startswith("psfs: error: ") and result.err.count("\n") == 1


def test_a_file_that_breaks_while_it_is_read(walk: Path) -> None:
    sequence = Sequence.open(walk)
    footage.write_video(walk / "videos/cam02.mp4", [50] * 10)
    seen = []
    with pytest.raises(InputError, match=r"cam02\.mp4: frame 10 of 40 cannot be decoded"):
        for frame in sequence:
            seen.append(frame.index)
    assert seen == list(range(10))


class SlowDecoder:
    """A decoder of one of two views that is still reading when the other fails."""

    reading = closed_while_reading = False

    def __init__(self, fails: bool) -> None:
        self.fails = fails

    def read(self, index: int, into: np.ndarray | None = None) -> np.ndarray:
        if self.fails:
            raise InputError("broken")
        SlowDecoder.reading = True
        time.sleep(0.2)
        SlowDecoder.reading = False
        return np.zeros((48, 64, 3), np.uint8)

    def close(self) -> None:
        SlowDecoder.closed_while_reading |= SlowDecoder.reading


def test_no_view_is_closed_while_it_is_read(walk: Path, monkeypatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 8)
    sequence = Sequence.open(walk)
    views = iter([True, *[False] * 7])
    monkeypatch.setattr("psfs.footage.media.Media.open", lambda media: SlowDecoder(next(views)))
    with pytest.raises(InputError, match="broken"):
        list(sequence)
    assert not SlowDecoder.closed_while_reading


def test_images_that_change_size_or_are_no_images(tmp_path: Path) -> None:
    footage.write_toml(tmp_path / "calibration.toml", footage.tables(footage.rig(1)))
    for frame, size in enumerate([(64, 48), (64, 48), (48, 64)]):
        footage.write_image(tmp_path / f"images/cam01/{frame}.png", 9, size)
    sequence = Sequence.open(tmp_path)
    with pytest.raises(InputError, match=r"2\.png: 48 x 64 pixels; expected 64 x 48"):
        list(sequence)
    (tmp_path / "images/cam01/1.png").write_bytes(b"no image")
    with pytest.raises(InputError, match=r"1\.png: cannot be decoded"):
        list(sequence)


def test_a_header_that_promises_two_frames_too_many(tmp_path: Path) -> None:
    """As in Utrecht's videos: the frames that decode are the length, without an error."""
    folder = footage.native(tmp_path / "walk", views=1, frames=30)
    path = folder / "videos/cam01.avi"
    footage.write_video(path, [0] * 30, codec="MJPG")
    (folder / "videos/cam01.mp4").unlink()
    data = path.read_bytes()
    wrong = data.replace((30).to_bytes(4, "little"), (32).to_bytes(4, "little"))
    path.write_bytes(wrong)
    assert cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FRAME_COUNT) == 32
    sequence = Sequence.open(folder)
    assert len(sequence) == len(list(sequence)) == 30
