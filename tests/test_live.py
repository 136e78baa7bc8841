"""Live tracking: what its parts do, and the whole of it from the command line."""

from __future__ import annotations

import json
import threading
from dataclasses import replace
from pathlib import Path

import cv2
import footage
import numpy as np
import pytest
from test_track_command import walk  # noqa: F401  a fixture

from apf.body import load_body, save_body
from apf.cli import main
from apf.commands.first_pose import first_pose
from apf.initial import read_pose, write_pose
from apf.live import Live
from apf.live_budget import FEWEST, MOST, Cost, Governor, evaluations, sized
from apf.live_captures import cameras_of
from apf.live_sources import ACQUISITION, Newest, Replay, Shot
from apf.live_timeline import Span, Timeline
from apf.methods import Method
from apf.track import Track
from cl import Device, UserError
from psfs.sequence import Sequence

STAGES = (ACQUISITION, "processing", "tracking")


def test_newest_drops_what_is_older() -> None:
    dropped: list[int] = []
    newest = Newest(dropped.append)
    for number in (1, 2, 3):
        newest.put(number)
    assert newest.take() == 3 and dropped == [1, 2]
    newest.put(4)
    newest.close()
    assert newest.take() == 4 and newest.take() is None and dropped == [1, 2]


def test_taking_waits_for_another_thread() -> None:
    newest = Newest(lambda item: None)
    taken: list[object] = []
    thread = threading.Thread(target=lambda: taken.extend([newest.take(), newest.take()]))
    thread.start()
    newest.put("a picture")
    newest.close()
    thread.join(10)
    assert not thread.is_alive() and taken == ["a picture", None]


def test_a_search_of_any_size() -> None:
    method = Method.of("pso", "sp")
    for count in (FEWEST, 900, 3000, MOST):
        chosen = sized(method, count)
        assert abs(evaluations(chosen) - count) < 0.15 * count
        assert 6 <= chosen.filter.n_layers <= 15
    assert sized(Method.of("sir", "sp"), 2000).filter.n_layers == 1
    assert sized(method, 3000).filter.n_layers > sized(method, 900).filter.n_layers


def test_cost_and_plan() -> None:
    cost = Cost.of((480, 1920), (0.030, 0.102))  # 6 ms and 0.05 ms each
    assert cost.fixed == pytest.approx(0.006) and cost.each == pytest.approx(5e-5)
    assert cost.allows(0.056) == pytest.approx(1000)
    assert cost.allows(0.001) == FEWEST and cost.allows(10) == MOST
    governor = Governor(0.1, cost)
    method = governor.plan(Method.of("pso", "sp"))
    assert cost.fixed + cost.each * evaluations(method) < 0.1
    assert evaluations(method) > 1200


def test_a_search_that_takes_too_long_shrinks_and_grows_again() -> None:
    governor = Governor(0.2, Cost(0.0, 5e-5))
    method = governor.plan(Method.of("pso", "sp"))
    assert all(governor.revised(method, 0.18) is None for _ in range(30))
    # Three times as dear, as on a busy machine.
    smaller = next(m for m in (governor.revised(method, 0.54) for _ in range(30)) if m)
    assert evaluations(smaller) < 0.5 * evaluations(method)
    larger = next(m for m in (governor.revised(smaller, 0.06) for _ in range(30)) if m)
    assert evaluations(larger) > 1.5 * evaluations(smaller)
    # At the smallest size there is nothing to choose.
    least = sized(method, FEWEST)
    assert all(governor.revised(least, 5.0) is None for _ in range(30))


def test_timeline_and_its_picture(tmp_path: Path) -> None:
    timeline = Timeline(STAGES)
    for frame in range(20):
        start = 0.1 * frame
        for number, stage in enumerate(STAGES):
            begin = start + 0.03 * number
            timeline.add(Span(stage, frame, begin, begin + 0.03))
        timeline._results.append((frame, start, start + 0.09))
    timeline.drop("processing", 3)
    summary = timeline.summary()
    assert summary["fps"] == pytest.approx(10, abs=0.01) and summary["results"] == 20
    assert summary["latency_ms"] == {"mean": 90.0, "p95": 90.0, "max": 90.0}
    assert summary["latency_frames"] == pytest.approx(0.9)
    assert summary["dropped"] == {ACQUISITION: 0, "processing": 1, "tracking": 0}
    timeline.plot(tmp_path / "timeline.png")
    picture = cv2.imread(str(tmp_path / "timeline.png"))
    coloured = np.ptp(picture.astype(int), axis=-1) > 60
    assert 0.05 < coloured.mean() < 0.8
    Timeline(STAGES).plot(tmp_path / "empty.png")  # a run without results has one, too


def test_a_block_that_raises_leaves_no_span() -> None:
    timeline = Timeline(STAGES)
    with pytest.raises(KeyError), timeline.span(ACQUISITION, 1):
        raise KeyError
    assert not timeline._spans


def acquired(source, stop: threading.Event | None = None) -> tuple[list[Shot], Timeline]:
    """All shots of a source, none superseded, and its timeline."""
    shots: list[Shot] = []
    timeline = Timeline(STAGES)
    newest = Newest(lambda shot: None)
    newest.put = shots.append  # type: ignore[method-assign]
    source.run(newest, timeline, stop or threading.Event())
    return shots, timeline


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


def test_captures_of_files(tmp_path: Path) -> None:
    folder = footage.native(tmp_path / "s", frames=12)
    videos = [str(folder / "videos" / f"cam{k:02d}.mp4") for k in (1, 2, 3)]
    cameras = cameras_of(folder, {}, videos, 0.0)
    assert cameras.fps == 25 and len(cameras.rig) == 3
    assert abs(cameras.background.mean[1].mean() - 101) < footage.LOSS  # from background/
    first = cameras.first()
    assert abs(int(first.images[2, 20, 20, 0]) - footage.grey(0, 2)) < footage.LOSS
    shots, _ = acquired(cameras)
    assert 1 <= len(shots) <= 11
    assert [s.time for s in shots] == sorted(s.time for s in shots)
    assert all(shot.frame.images.shape == (3, 48, 64, 3) for shot in shots)


def test_a_background_filmed_first(tmp_path: Path) -> None:
    folder = footage.native(tmp_path / "s", frames=8)
    videos = [str(path) for path in sorted((folder / "videos").iterdir())]
    cameras = cameras_of(folder / "calibration.toml", {}, videos, 0.12)  # three frames of 25/s
    levels = np.mean([footage.grey(frame, 0) for frame in range(3)])
    assert abs(cameras.background.mean[0].mean() - levels) < footage.LOSS
    assert abs(int(cameras.first().images[0, 9, 9, 0]) - footage.grey(3, 0)) < footage.LOSS
    cameras.close()


def test_bad_captures(tmp_path: Path) -> None:
    folder = footage.native(tmp_path / "s", frames=2)
    videos = [str(path) for path in sorted((folder / "videos").iterdir())]
    footage.write_video(tmp_path / "wide.mp4", [1, 2], size=(80, 48))
    for names, message in (
        (videos[:2], "2 captures .* expected 3"),
        ([*videos[:2], "absent.mp4"], "absent.mp4: cannot be opened"),
        ([*videos[:2], str(tmp_path / "wide.mp4")], "80 x 48 pixels; camera cam03"),
    ):
        with pytest.raises(UserError, match=message):
            cameras_of(folder, {}, names, 0.0).first()


@pytest.fixture(scope="module")
def filmed(walk: Path) -> Path:  # noqa: F811
    """The folder of a walk with body.toml and start.txt, fitted once for all tests."""
    found = first_pose(Sequence.open(walk), 0, None, walk / "truth.npz", "y-up")
    assert found is not None
    save_body(walk / "body.toml", found[0])
    write_pose(walk / "start.txt", found[1])
    return walk


def live(folder: Path, out: Path, *more: str) -> int:
    start = ["--body", str(folder / "body.toml"), "--init", str(folder / "start.txt")]
    own = "--truth" in more or "--captures" in more  # whose frames are not the truth's
    truth = [] if own else ["--truth", str(folder / "truth.npz")]
    return main(["live", str(folder), "-o", str(out), *start, *truth, *more])


def test_a_recording_from_the_command_line(filmed: Path, tmp_path: Path, capfd) -> None:
    out = tmp_path / "out"
    assert live(filmed, out, "--particles", "48", "--layers", "6") == 0
    names = {path.name for path in out.iterdir()}
    assert names >= {"track.npz", "joints.trc", "joints.csv", "live.json", "timeline.png"}
    track, summary = Track.load(out), json.loads((out / "live.json").read_text())
    assert 1 <= len(track) == summary["results"] <= 5
    assert np.all(np.diff(track.frames) > 0) and track.fps == 60
    assert summary["sizes"] == [[0, 48, 6]]
    assert summary["error_mm"] < 150
    assert len(track) + sum(summary["dropped"].values()) <= 5
    assert "mean error" in capfd.readouterr().out


def test_videos_as_cameras(filmed: Path, tmp_path: Path) -> None:
    videos = [str(path) for path in sorted((filmed / "videos").iterdir())]
    more = ("--fps", "4", "--captures", *videos)
    assert live(filmed, tmp_path / "out", *more) == 0
    track = Track.load(tmp_path / "out")
    assert len(track) >= 1
    sizes = json.loads((tmp_path / "out" / "live.json").read_text())["sizes"]
    assert all(FEWEST * 0.8 <= particles * layers <= MOST * 1.2 for _, particles, layers in sizes)


def prepared(folder: Path) -> Live:
    body = load_body(folder / "body.toml")
    pose = read_pose(folder / "start.txt", body)
    method = Method.of("pso", "sp", n_particles=48, n_layers=6)
    source = Replay(Sequence.open(folder), range(5))
    return Live(Device.best(), source, None, body, pose, method, None)


def test_stopped_it_keeps_what_it_has(filmed: Path) -> None:
    run = prepared(filmed)

    def interrupt(result: object, timeline: Timeline) -> None:
        raise KeyboardInterrupt

    result = run.run(interrupt)
    assert len(result.frames) == len(result.estimates) <= 5
    assert threading.active_count() < 20


def test_what_a_thread_raises_ends_the_run(filmed: Path, monkeypatch) -> None:
    run = prepared(filmed)

    def broken(frame: object) -> None:
        raise UserError("the picture is torn")

    monkeypatch.setattr(run, "_observe", broken)
    with pytest.raises(UserError, match="torn"):
        run.run()


def test_a_search_is_resized_where_it_stands(filmed: Path) -> None:
    run = prepared(filmed)
    run._governor = Governor(1e-4, Cost(0.0, 1e-6))  # which nothing can keep
    run._method = replace(run._method, filter=replace(run._method.filter, n_particles=320))
    estimate = run._tracker.step(run._observe(run.source.first()))
    run._keep(estimate)
    for _ in range(10):
        run._resize(0.1)
    assert run.result.sizes[-1][1:] == (96, 10)
    again = run._tracker.step(run._observe(run.source.first()))
    assert np.abs(again.pose - estimate.pose).max() < 0.5


def test_a_pose_that_fits_nothing_is_not_kept(filmed: Path) -> None:
    run = prepared(filmed)
    good = run._tracker.step(run._observe(run.source.first()))
    run._keep(good)
    far = replace(good, pose=good.pose + 5, least_error=np.ones(6))
    run._keep(far)
    again = run._tracker.step(run._observe(run.source.first()))
    assert np.abs(again.pose - good.pose).max() < 0.5


@pytest.mark.parametrize(
    "more",
    [
        ["--fps", "0"],
        ["--device", "numpy"],
        ["--objective", "best"],
        ["--captures", "absent.mp4"],
        ["--truth", "absent.npz"],
    ],
)
def test_bad_flags(more: list[str], filmed: Path, tmp_path: Path, capfd) -> None:
    assert live(filmed, tmp_path / "out", *more) == 2
    lines = capfd.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("apf: error: "), lines
    assert not (tmp_path / "out").exists()
