"""Cameras are shifted by the sound of their videos."""

from pathlib import Path

import av
import numpy as np
import pytest

from cl import InputError
from psfs.calibration.targets.detection import open_uncalibrated
from psfs.footage.settings import SequenceSettings
from psfs.request import parse_sync

RATE, FPS = 16000, 20


def room(seconds: float) -> np.ndarray:
    """Sound (N,) of a room: talk-like noise and a clap."""
    random = np.random.default_rng(3)
    count = int(seconds * RATE)
    slow = np.interp(np.arange(count), np.arange(0, count, 800), random.random(-(-count // 800)))
    sound = 0.02 * random.normal(size=count) * slow
    clap = int(0.6 * seconds * RATE)
    sound[clap : clap + 400] += 0.5 * random.normal(size=400) * np.exp(-np.arange(400) / 100)
    return sound


def film(path: Path, sound: np.ndarray | None, frames: int = 50) -> None:
    """Write a small grey video with a sound track."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        video = container.add_stream("mpeg4", rate=FPS)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        audio = container.add_stream("aac", rate=RATE, layout="mono") if sound is not None else None
        for number in range(frames):
            picture = np.full((48, 64, 3), 4 * number % 256, np.uint8)
            container.mux(video.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        container.mux(video.encode())
        if audio is not None and sound is not None:
            frame = av.AudioFrame.from_ndarray(sound.astype(np.float32)[None], "fltp", "mono")
            frame.sample_rate = RATE
            container.mux(audio.encode(frame))
            container.mux(audio.encode())


@pytest.fixture
def takes(tmp_path: Path) -> Path:
    """Three cameras: b starts 7 frames after a, c 5 frames before it, with noises of their own."""
    sound, random = room(5.0), np.random.default_rng(4)
    for name, begins in (("a", 1.0), ("b", 1.35), ("c", 0.75)):
        own = sound[int(begins * RATE) :][: int(2.5 * RATE)]
        film(tmp_path / "videos" / f"{name}.mp4", own + 0.002 * random.normal(size=len(own)))
    return tmp_path


def test_cameras_are_shifted_by_their_sound(takes: Path) -> None:
    views = open_uncalibrated(takes, SequenceSettings(sync="audio"))
    assert views.settings.sync == {"a": 0, "b": -7, "c": 5}
    images = views.read(0).images
    assert images is not None
    # The first common picture is 7 of a, 0 of b and 12 of c.
    np.testing.assert_allclose([image.mean() for image in images], [28, 0, 48], atol=4)
    assert parse_sync("audio") == "audio"


def test_a_clock_that_runs_differently_is_followed(tmp_path: Path) -> None:
    """Of two phones one counts 0.5 % more seconds, and begins 0.35 s later."""
    random, frames, speed = np.random.default_rng(6), 600, 1.005
    sound = room(frames / FPS + 2)
    ticks = np.arange(frames / FPS * RATE)
    for name, places in (("a", ticks), ("b", 0.35 * RATE + ticks / speed)):
        heard = np.interp(places, np.arange(len(sound)), sound)
        film(
            tmp_path / "videos" / f"{name}.mp4",
            heard + 0.002 * random.normal(size=len(ticks)),
            frames,
        )
    views = open_uncalibrated(tmp_path, SequenceSettings(sync="audio"))
    assert views.settings.sync["b"] == [-7, pytest.approx(speed, abs=2e-5)]
    a, b = (np.array(item.picks) for item in views.footage.images)
    assert len(a) > 580 and np.abs(a - (7 + b / speed)).max() < 0.55
    assert any("(its clock runs +0.50%)" in note for note in views.notes)


def test_fractions_of_a_frame_are_told(tmp_path: Path) -> None:
    """Two phones whose pictures are 7.35 frames apart; each has its own noise and loudness."""
    sound, random = room(5.0), np.random.default_rng(5)
    for name, begins, gain in (("a", 1.0, 1.0), ("b", 1.0 + 7.35 / FPS, 0.3)):
        own = gain * sound[round(begins * RATE) :][: int(2.5 * RATE)]
        film(tmp_path / "videos" / f"{name}.mp4", own + 0.002 * random.normal(size=len(own)))
    views = open_uncalibrated(tmp_path, SequenceSettings(sync="audio"))
    assert views.settings.sync == {"a": 0, "b": -7}
    (note,) = [note for note in views.notes if "by the sound" in note]
    assert abs(float(note.split("b ")[1].split(";")[0]) + 7.35) < 0.02


def test_videos_without_sound_or_of_other_rooms_are_named(takes: Path) -> None:
    film(takes / "videos" / "c.mp4", None)
    with pytest.raises(InputError, match=r"c\.mp4: no sound"):
        open_uncalibrated(takes, SequenceSettings(sync="audio"))
    film(takes / "videos" / "c.mp4", 0.1 * np.random.default_rng(9).normal(size=2 * RATE))
    with pytest.raises(InputError, match=r"c\.mp4: its sound fits .* at no offset"):
        open_uncalibrated(takes, SequenceSettings(sync="audio"))
    with pytest.raises(InputError, match=r"expected audio .*from_phones"):
        open_uncalibrated(takes, SequenceSettings(sync="auto"))
