"""Where live frames come from, and pictures made smaller."""

import errno
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from helpers import footage

from apf.live.cameras import Captures, LiveCamera, open_cameras
from apf.live.session import STAGES
from apf.live.sources import ACQUISITION, Newest, Replay, Shot, Smaller, fitting_factor
from apf.live.timeline import Timeline
from apf.synthetic.scene import SceneConfig, make_rig
from cl import InputError
from psfs.output.video import Video
from psfs.sequence import Sequence
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.occupied_box import finest_pixel


def test_newest_drops_what_is_older() -> None:
    dropped: list[int] = []
    newest = Newest(dropped.append)
    for number in (1, 2, 3):
        newest.put(number)
    assert newest.take() == 3 and dropped == [1, 2]
    newest.put(4)
    newest.close()
    assert newest.take() == 4 and newest.take() is None and dropped == [1, 2]


def acquired(source, stop: threading.Event | None = None) -> tuple[list[Shot], Timeline]:
    """All shots of a source, none superseded, and its timeline."""
    shots: list[Shot] = []
    timeline = Timeline(STAGES)
    newest = Newest(lambda shot: None)
    newest.put = shots.append  # type: ignore[method-assign]
    source.run(newest, timeline, stop or threading.Event())
    return shots, timeline


def list_videos(folder: Path) -> list[str]:
    return [str(path) for path in sorted((folder / "videos").iterdir())]


def test_replay_keeps_the_recordings_time(tmp_path: Path) -> None:
    sequence = Sequence.open(footage.native(tmp_path / "s"))
    shots, timeline = acquired(Replay(sequence, range(1, 11, 2)))
    indices = [shot.frame.index for shot in shots]
    assert len(indices) + timeline.dropped[ACQUISITION] == 5
    assert indices == sorted(set(indices) & {1, 3, 5, 7, 9})
    for shot in shots:
        since = shot.time - shots[0].time
        assert since == pytest.approx((shot.frame.index - indices[0]) / 25)
        assert abs(int(shot.frame.images[0, 20, 20, 0]) - footage.grey(shot.frame.index, 0)) < 6
    stopped = threading.Event()
    stopped.set()
    assert acquired(Replay(sequence, range(12)), stopped)[0] == []


def test_smaller_footage(tmp_path: Path) -> None:
    sequence = Sequence.open(footage.native(tmp_path / "s", frames=2))
    smaller, frame = Smaller(sequence, 0.5), sequence.read(1)
    assert smaller.rig[0].size == (32, 24)
    small = smaller.resize(frame)
    assert small.images.shape == (3, 24, 32, 3) and small.index == 1
    blocks = frame.images.reshape(3, 24, 2, 32, 2, 3).mean((2, 4))
    assert np.abs(small.images - blocks).max() <= 0.5
    blocks = sequence.background.mean.reshape(3, 24, 2, 32, 2, 3).mean((2, 4))
    np.testing.assert_allclose(smaller.background.mean, blocks, atol=1e-3)
    # A point is seen in the middle of the pixels that it is the mean of.
    point = np.array([[0.1, 0.2, 0.9]])
    before, after = (rig[1].project(point)[0] for rig in (sequence.rig, smaller.rig))
    np.testing.assert_allclose(after + 0.5, (before + 0.5) / 2)
    same = Smaller(sequence, 1.0)
    assert same.resize(frame).images is frame.images
    assert same.background is sequence.background


def test_pictures_as_fine_as_voxels() -> None:
    rig = make_rig(SceneConfig(cameras=4))

    def grid(voxel_size: float) -> VoxelGrid:
        return VoxelGrid(np.array([0, 0, 1.0]), voxel_size, (2, 2, 2))

    pixel = finest_pixel(rig, grid(0.02))
    for voxel, factor in ((0.9, 1), (1.9, 1), (2.1, 0.5), (3.9, 0.5), (4.1, 0.25)):
        assert fitting_factor(rig, grid(voxel * pixel)) == factor


def test_captures_of_files(tmp_path: Path) -> None:
    folder = footage.native(tmp_path / "s", frames=12)
    cameras = open_cameras(folder, {}, list_videos(folder), 0.0)
    assert cameras.fps == 25 and len(cameras.rig) == 3
    assert abs(cameras.background.mean[1].mean() - 101) < footage.LOSS  # from background/
    first = cameras.first()
    assert abs(int(first.images[2, 20, 20, 0]) - footage.grey(0, 2)) < footage.LOSS
    shots, _ = acquired(cameras)
    assert 1 <= len(shots) <= 11
    assert [s.time for s in shots] == sorted(s.time for s in shots)
    assert all(shot.frame.images.shape == (3, 48, 64, 3) for shot in shots)
    footage.write_video(folder / "videos" / "cam03.mp4", [1, 2], size=(80, 48))
    with pytest.raises(InputError, match="80 x 48 pixels; camera cam03"):
        open_cameras(folder, {}, list_videos(folder), 0.0).first()


def test_pictures_that_come_unevenly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two within one step, and one from before the first step, have numbers of their own."""
    folder = footage.native(tmp_path / "s", views=2)
    steps = iter([(step / 25, n) for step in (-0.8, 0.1, 0.2, 0.3, 3.4) for n in (0, 1)])
    now = time.perf_counter()

    def next_picture(*_: object) -> tuple[int, float, np.ndarray | None]:
        when, _ = next(steps, (None, None))
        picture = None if when is None else np.zeros((48, 64, 3), np.uint8)
        return 0, now + (when or 0.0), picture

    cameras = open_cameras(folder, {}, list_videos(folder), 0.0)
    monkeypatch.setattr("apf.live.cameras.LiveCamera.next", next_picture)
    monkeypatch.setattr("apf.live.cameras.time.perf_counter", lambda: now)
    shots, _ = acquired(cameras)
    assert [shot.frame.index for shot in shots] == [0, 1, 2, 3, 4]


def test_a_full_disk_ends_a_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = footage.native(tmp_path / "s", views=2)

    def write(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    records, play = threading.Event(), LiveCamera.play

    def play_when_recorded(camera: LiveCamera) -> None:
        assert records.wait(60)  # else a busy machine's video of 0.5 s ends before it is recorded
        play(camera)

    monkeypatch.setattr(LiveCamera, "play", play_when_recorded)
    monkeypatch.setattr(Video, "write", write)
    captures = Captures(list_videos(folder))
    captures.record(tmp_path / "out", ["a", "b"])
    records.set()
    assert captures.wait(10**6, 60.0) is None and "No space left" in captures.ended
    with pytest.raises(InputError, match="0 of 0 pictures"):
        captures.stop_recording()
    captures.close()


def test_a_background_filmed_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = footage.native(tmp_path / "s", frames=8)
    for n_kept in (3, 1):
        calibration = folder / "calibration.toml"
        cameras = open_cameras(calibration, {}, list_videos(folder), 0.12)  # three frames of 25/s
        level = np.mean([footage.grey(frame, 0) for frame in range(n_kept)])
        assert abs(cameras.background.mean[0].mean() - level) < footage.LOSS
        assert abs(int(cameras.first().images[0, 9, 9, 0]) - footage.grey(3, 0)) < footage.LOSS
        cameras.close()
        monkeypatch.setattr("apf.live.cameras._EMPTY_BYTES", 0)
        monkeypatch.setattr("apf.live.cameras._LEAST_EMPTY", 1)  # there is room for one of them
