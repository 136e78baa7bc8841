"""Cameras are shifted by the sound of their videos."""

from pathlib import Path

import numpy as np
import pytest
from helpers import footage

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


def film(path: Path, sound: np.ndarray, seed: int, frames: int = 50) -> None:
    """Write a small grey video whose sound has a noise of its own."""
    sound = sound + 0.002 * np.random.default_rng(seed).normal(size=len(sound))
    footage.write_film(path, np.arange(frames) * 4 % 256, FPS, (sound, RATE))


def film_room(folder: Path, begins: dict[str, float], seconds: float = 2.5) -> Path:
    """Write videos that begin at these times, s."""
    sound = room(5.0)
    for seed, (name, begin) in enumerate(begins.items()):
        heard = sound[round(begin * RATE) :][: int(seconds * RATE)]
        film(folder / "videos" / f"{name}.mp4", heard * 0.5**seed, seed)
    return folder


@pytest.fixture
def takes(tmp_path: Path) -> Path:
    """Three cameras: b starts 7 frames after a, c 5 frames before it."""
    return film_room(tmp_path, {"a": 1.0, "b": 1.35, "c": 0.75})


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
    frames, speed = 600, 1.005
    sound = room(frames / FPS + 2)
    ticks = np.arange(frames / FPS * RATE)
    for seed, places in enumerate((ticks, 0.35 * RATE + ticks / speed)):
        heard = np.interp(places, np.arange(len(sound)), sound)
        film(tmp_path / "videos" / f"{'ab'[seed]}.mp4", heard, seed, frames)
    views = open_uncalibrated(tmp_path, SequenceSettings(sync="audio"))
    assert views.settings.sync["b"] == [-7, pytest.approx(speed, abs=2e-5)]
    a, b = (np.array(item.picks) for item in views.footage.images)
    assert len(a) > 580 and np.abs(a - (7 + b / speed)).max() < 0.55
    assert any("(its clock runs +0.50%)" in note for note in views.notes)


def test_fractions_of_a_frame_are_told(tmp_path: Path) -> None:
    """Two phones whose pictures are 7.35 frames apart; each has its own noise and loudness."""
    film_room(tmp_path, {"a": 1.0, "b": 1.0 + 7.35 / FPS})
    views = open_uncalibrated(tmp_path, SequenceSettings(sync="audio"))
    assert views.settings.sync == {"a": 0, "b": -7}
    (note,) = [note for note in views.notes if "by the sound" in note]
    assert abs(float(note.split("b ")[1].split(";")[0]) + 7.35) < 0.02


def test_videos_without_sound_or_of_other_rooms_are_named(takes: Path) -> None:
    footage.write_film(takes / "videos" / "c.mp4", [0] * 50)
    with pytest.raises(InputError, match=r"c\.mp4: no sound"):
        open_uncalibrated(takes, SequenceSettings(sync="audio"))
    film(takes / "videos" / "c.mp4", 0.1 * np.random.default_rng(9).normal(size=2 * RATE), 5)
    with pytest.raises(InputError, match=r"c\.mp4: its sound fits .* at no offset"):
        open_uncalibrated(takes, SequenceSettings(sync="audio"))
    with pytest.raises(InputError, match=r"expected audio .*from_phones"):
        open_uncalibrated(takes, SequenceSettings(sync="auto"))
