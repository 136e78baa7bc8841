"""Times of cameras: stated in timestamps.csv, by lags in frames, or estimated from signals."""

import shutil
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from helpers import footage

from cl import InputError
from psfs.calibration.targets.detection import open_uncalibrated
from psfs.footage.camera_times import (
    CameraTimes,
    MeasuredOffset,
    combine_offsets,
    compare_signals,
)
from psfs.footage.layouts.uncalibrated import read_uncalibrated
from psfs.footage.settings import SequenceSettings
from psfs.footage.timing import Timing, pair_frames, synchronise
from psfs.sequence import Sequence

TIMES = {0: [1.0, 1.1, 1.2, 1.3, 1.4, 1.5], 1: [1.09, 1.21, 1.41, 1.5]}  # 1.3 was dropped


def film(folder: Path) -> Path:
    rows = ["sync_index,cam_id,frame_index,frame_time"]
    for camera, times in TIMES.items():
        levels = [round(100 * (time - 0.9)) for time in times]
        footage.write_video(folder / f"cam_{camera}.avi", levels, 10, codec="MJPG")
        for number, time in enumerate(times):
            rows.insert(1, f"{number},{camera},{number + 7},{time}")
    (folder / "timestamps.csv").write_text("\n".join(rows))
    return folder


def opened(folder: Path) -> Sequence:
    return open_uncalibrated(folder, SequenceSettings())


def test_frames_of_the_same_time_go_together(tmp_path: Path) -> None:
    views = opened(film(tmp_path))
    assert len(views) == 4
    shown = [[float(image.mean()) for image in frame.images] for frame in views]  # type: ignore[union-attr]
    expected = [[20, 19], [30, 31], [50, 51], [60, 60]]
    np.testing.assert_allclose(shown, expected, atol=2)
    note = "timestamps.csv: 4 of up to 6, 10 per second, at most 10 ms apart"
    assert any(note in text for text in views.notes)


def test_masks_go_with_the_pictures(tmp_path: Path) -> None:
    masks = tmp_path / "masks"
    masks.mkdir()
    for video in film(tmp_path).glob("*.avi"):
        shutil.copy(video, masks)
    read = read_uncalibrated(tmp_path, SequenceSettings(), silhouettes=True)
    paired, _, _ = synchronise(read, None, {}, 30)
    assert [item.count for item in paired.masks or ()] == [4, 4]
    shutil.copy(masks / "cam_1.avi", masks / "cam_0.avi")
    read = read_uncalibrated(tmp_path, SequenceSettings(), silhouettes=True)
    with pytest.raises(InputError, match="6 times of cam_0, whose video has 4 frames"):
        synchronise(read, None, {}, 30)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("frame_time", "when"), "expected cam_id"),
        (lambda text: text.replace("1.21", "soon"), "line 4; expected"),
        (lambda text: text.rsplit("\n", 1)[0], "5 times of cam_0, whose video has 6"),
        (lambda text: text.replace(",1,", ",5,"), "0 cameras match cam_1; found 5, 0"),
    ],
)
def test_files_that_do_not_fit(tmp_path: Path, change, message: str) -> None:
    path = film(tmp_path) / "timestamps.csv"
    path.write_text(change(path.read_text()))
    with pytest.raises(InputError, match=message):
        opened(tmp_path)


def test_the_earlier_of_two_that_are_equally_near() -> None:
    times = [np.array([0.0, 2.0, 4.0]), np.array([-1.0, 1.0, 3.0, 4.5])]
    assert pair_frames(times) == ([(0, 0), (1, 1), (2, 3)], 1.0)
    assert pair_frames([np.array([0.0]), np.array([-1.0, 0.0])]) == ([(0, 1)], 0.0)


def test_lags_of_the_sequence_in_frames_of_each_camera(tmp_path: Path) -> None:
    assert Timing((60.0, 30.0, 15.0)).count_own_frames([3.2, 1.3, 0.9]) == [13, 3, 1]
    folder = footage.native(tmp_path, views=2, frames=1)
    # The first camera has twice the rate; both show the same times, the second from 2/5 s on.
    footage.write_video(folder / "videos" / "cam01.mp4", list(range(0, 240, 10)), 10.0)
    footage.write_video(folder / "videos" / "cam02.mp4", list(range(40, 240, 20)), 5.0)
    sequence = Sequence.open(folder)
    assert sequence.fps == 5
    shifted = sequence.synchronise({"cam01": 2})
    assert shifted.settings.sync == {"cam01": 4}
    images = shifted.read(1).images
    assert images is not None
    np.testing.assert_allclose(images.mean(axis=(1, 2, 3)), 60, atol=footage.LOSS)


FRAMES, MOST = 200, 30


def signals(offsets: list[float], noise: float, seed: int = 0) -> list[np.ndarray]:
    """A smooth random signal (F, 1) as cameras of these offsets show it, each with a constant and
    noise of its own."""
    random = np.random.default_rng(seed)
    knots = random.normal(size=FRAMES)
    times = np.arange(FRAMES, dtype=float)
    shown = [np.interp(times - by, 6 * np.arange(FRAMES) - 300, knots) for by in offsets]
    return [(s + random.normal(size=FRAMES) * noise + k)[:, None] for k, s in enumerate(shown)]


def estimate(shown: list[np.ndarray]):
    pairs = combinations(range(len(shown)), 2)
    costs = {(a, b): compare_signals(shown[a], shown[b], 2 * MOST, 10.0) for a, b in pairs}
    return CameraTimes(len(shown), costs)


@pytest.mark.parametrize("offsets", [[0, 0, 7, 0], [0, -12, 0, 3.4, 0.3]])
def test_offsets_by_signals_with_their_deviations(offsets: list[float]) -> None:
    found = estimate(signals(offsets, 0.1))
    expected = np.array(offsets) - np.median(offsets)
    assert (np.abs(found.offsets - expected) < np.maximum(4 * found.sigmas, 0.15)).all()
    assert (found.sigmas < 0.5).all()
    assert ((found.chances < 1e-3) == (np.abs(expected) > 1)).all()


def test_signals_that_have_nothing_in_common_tell_no_offset() -> None:
    for seed in range(10):
        shown = [signals([0], 0.1, 10 * seed + k)[0] for k in range(4)]
        assert estimate(shown).chances.min() > 1e-3


def test_measured_offsets_are_weighted_by_their_deviations() -> None:
    rows = [MeasuredOffset(0, 1, 2.0, 0.1), MeasuredOffset(1, 2, 1.0, 0.1)]
    offsets, sigmas = combine_offsets(3, [*rows, MeasuredOffset(0, 2, 9.0, 100.0)])
    np.testing.assert_allclose(offsets, [-2, 0, 1], atol=1e-3)
    assert sigmas.max() < 0.2
