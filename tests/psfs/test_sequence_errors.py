"""Bad input through the command line: exit code 2, one line, nothing written."""

import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import footage
from helpers.commands import run_python
from helpers.footage import cut

from cl import InputError
from psfs.cli import main
from psfs.sequence import Sequence


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return footage.native(tmp_path_factory.mktemp("original") / "walk", frames=40)


@pytest.fixture
def walk(original: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(original, tmp_path / "walk"))


def cut_after_the_index(path: Path) -> None:
    """Write a truncated video whose leading index (as for streaming) promises more frames."""
    data = path.read_bytes()
    start, header = data.index(b"mdat") - 4, data.index(b"moov") - 4
    moov = bytearray(data[header:])
    table = moov.index(b"stco") + 8
    for i in range(int.from_bytes(moov[table : table + 4], "big")):
        at = table + 4 + 4 * i
        offset = int.from_bytes(moov[at : at + 4], "big") + len(moov)
        moov[at : at + 4] = offset.to_bytes(4, "big")
    pictures = data[start:header]
    path.write_bytes(data[:start] + bytes(moov) + pictures[: len(pictures) // 2])


def edit(folder: Path, change: Callable[[dict], object]) -> None:
    tables = footage.tables(footage.rig(3))
    change(tables)
    footage.write_toml(folder / "calibration.toml", tables)


def write(path: Path, text: str) -> None:
    path.write_text(text)


def leave_only_videos(folder: Path) -> None:
    videos = [path.rename(folder.parent / path.name) for path in folder.glob("videos/*")]
    shutil.rmtree(folder)
    folder.mkdir()
    for path in videos:
        path.rename(folder / path.name)


PROBLEMS: dict[str, tuple[Callable[[Path], object], str]] = {
    "no folder": (lambda f: shutil.rmtree(f), "no such folder"),
    "empty folder": (lambda f: [shutil.rmtree(f), f.mkdir()], "no sequence is recognised"),
    "no calibration": (lambda f: (f / "calibration.toml").unlink(), "no calibration"),
    "videos alone": (leave_only_videos, "no calibration; expected calibration.toml"),
    "no pictures": (lambda f: [p.unlink() for p in f.glob("videos/*")], "no pictures"),
    "truncated streaming video": (
        lambda f: cut_after_the_index(f / "videos/cam02.mp4"),
        "of the 40 frames that its header promises",
    ),
    "3 cameras for 4 videos": (
        lambda f: shutil.copy(f / "videos/cam01.mp4", f / "videos/cam04.mp4"),
        "4 of them (cam01, cam02, cam03, cam04) for 3 cameras (cam01, cam02, cam03)",
    ),
    "3 cameras for 2 videos": (lambda f: (f / "videos/cam01.mp4").unlink(), "for 3 cameras"),
    "a background is missing": (lambda f: (f / "background/cam01.mp4").unlink(), "background"),
    "NaN": (
        lambda f: edit(f, lambda t: t["cam01"].update(translation=[0.0, float("nan"), 1.0])),
        "calibration.toml: camera cam01: translation holds a number that is not finite",
    ),
    "malformed toml": (lambda f: write(f / "calibration.toml", "[cam01"), "malformed TOML"),
    "malformed settings": (lambda f: write(f / "sequence.toml", "up = "), "sequence.toml: malf"),
    "wrong type": (lambda f: write(f / "sequence.toml", "fps = 'fast'"), "fps is 'fast'"),
    "unknown kind": (lambda f: write(f / "sequence.toml", "background = 'x'"), "background is 'x'"),
    "no masks": (lambda f: write(f / "sequence.toml", "background = 'masks'"), "needs masks"),
    "no threshold": (lambda f: write(f / "sequence.toml", "background='threshold'"), "`threshold`"),
    "two calibrations": (
        lambda f: shutil.copy(
            (f / "calibration.toml").rename(f / "calib1.toml"), f / "calib2.toml"
        ),
        "several calibrations (calib1.toml, calib2.toml)",
    ),
}


@pytest.mark.parametrize("problem", PROBLEMS)
def test_one_line_and_exit_code_2(
    walk: Path, problem: str, capfd: pytest.CaptureFixture[str]
) -> None:
    break_it, expected = PROBLEMS[problem]
    break_it(walk)
    before = sorted(walk.parent.rglob("*"))
    assert main(["info", str(walk)]) == 2
    captured = capfd.readouterr()
    assert captured.err.startswith("psfs: error: ") and captured.err.count("\n") == 1
    assert expected in captured.err and captured.out == ""
    assert sorted(walk.parent.rglob("*")) == before


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
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25, footage.SIZE)
    for _ in range(30):
        writer.write(np.zeros((48, 64, 3), np.uint8))
    writer.release()
    (folder / "videos/cam01.mp4").unlink()
    data = path.read_bytes()
    wrong = data.replace((30).to_bytes(4, "little"), (32).to_bytes(4, "little"))
    path.write_bytes(wrong)
    assert cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FRAME_COUNT) == 32
    sequence = Sequence.open(folder)
    assert len(sequence) == len(list(sequence)) == 30
