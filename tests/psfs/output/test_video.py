"""Videos are written completely, in H.264."""

import signal
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from cl import InputError
from psfs.output.video import write_video


def pictures(n: int, shape: tuple[int, int] = (64, 96)) -> list[np.ndarray]:
    """Return pictures of a bright moving bar."""
    out = np.zeros((n, *shape, 3), np.uint8)
    for number, picture in enumerate(out):
        picture[:, 4 * number : 4 * number + 8] = (40, 120, 250)
    return list(out)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    shown = pictures(20)
    with write_video(tmp_path / "new" / "a.mp4", 25) as video:
        for picture in shown:
            video.write(picture)
    with av.open(str(tmp_path / "new" / "a.mp4")) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "h264" and stream.pix_fmt == "yuv420p"
        assert stream.average_rate == 25 and stream.frames == 20
        read = [frame.to_ndarray(format="bgr24") for frame in container.decode(stream)]
    error = np.abs(np.array(read, int) - np.array(shown)).mean()
    assert len(read) == 20 and error < 6
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.mp4"]


def test_same_pictures_give_the_same_file(tmp_path: Path) -> None:
    """With B frames most of the files differed (x264 of PyAV 18.1)."""
    rng = np.random.default_rng(0)
    room = cv2.resize(rng.integers(40, 220, (13, 17, 3), np.uint8), (320, 240))
    shown = [np.clip(room + rng.normal(0, 3, room.shape), 0, 255) for _ in range(12)]
    files = set()
    for _ in range(3):
        with write_video(tmp_path / "a.mp4", 30, quality=12) as video:
            for picture in shown:
                video.write(picture.astype(np.uint8))
        files.add((tmp_path / "a.mp4").read_bytes())
    assert len(files) == 1


def test_odd_sides(tmp_path: Path) -> None:
    with write_video(tmp_path / "a.mp4", 29.97) as video:
        for picture in pictures(3, (33, 47)):
            video.write(picture)
    capture = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    assert capture.get(cv2.CAP_PROP_FRAME_WIDTH) == 48
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(29.97, abs=0.01)


def test_nothing_stays_of_one_that_fails(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_text("older")
    with pytest.raises(RuntimeError), write_video(tmp_path / "a.mp4", 25) as video:
        video.write(pictures(1)[0])
        raise RuntimeError
    with (
        pytest.raises(InputError, match="0 of 0 pictures"),
        write_video(tmp_path / "a.mp4", 25),
    ):
        pass
    with (
        pytest.raises(InputError, match="cannot be written"),
        write_video(tmp_path / "a.mp4" / "b.mp4", 25),
    ):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]
    assert (tmp_path / "a.mp4").read_text() == "older"


def test_a_full_disk_is_said(tmp_path: Path) -> None:
    """A limit on file sizes simulates a full disk."""
    resource = pytest.importorskip("resource")
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (30, 240, 320, 3), np.uint8)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))
        with pytest.raises(InputError, match=r"a\.mp4"), write_video(tmp_path / "a.mp4", 25) as v:
            for picture in noise:
                v.write(picture)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert not list(tmp_path.iterdir())
