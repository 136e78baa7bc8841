"""Live tracking: what its parts do, and the whole of it from the command line."""

from __future__ import annotations

import json
import threading
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import footage

from apf.api import given_start
from apf.body import load_body, save_body
from apf.body.kinematics import posed_joints
from apf.cli import main
from apf.filters.base import Estimate
from apf.filters.method import Method
from apf.formats.trc import JointSeries
from apf.initialisation.from_joints import read_pose, write_pose
from apf.live.budget import FEWEST, MOST, Governor, evaluations, sized, sizes
from apf.live.captures import cameras_of
from apf.live.error import live_errors
from apf.live.pictures import Smaller, fitting_factor
from apf.live.session import Live, Observed, translation
from apf.live.sources import ACQUISITION, Newest, Replay, Shot
from apf.live.timeline import Span, Timeline
from apf.results.joint_names import EVALUATED_JOINTS
from apf.synthetic.scene import SceneConfig, make_rig
from apf.tracking.track import Track
from cl import Device, InputError
from psfs.sequence import Sequence
from psfs.volume import automatic_grid
from psfs.voxels.bounding_volume import finest_pixel
from psfs.voxels.grid import VoxelGrid

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


def test_sizes_to_choose_from() -> None:
    counts = [evaluations(method) for method in sizes(Method())]
    assert counts == sorted(counts)
    assert counts[0] == pytest.approx(FEWEST, rel=0.1) and counts[-1] == pytest.approx(MOST, 0.1)
    trunk = [m.filter.trunk_layers / m.filter.n_layers for m in sizes(Method())]
    assert all(0.25 < share < 0.4 for share in trunk)


COSTS = [0.01, 0.02, 0.03, 0.04]


def test_the_search_takes_what_processing_leaves() -> None:
    assert Governor(0.06, COSTS, 0.02).place == 2  # 0.85 * 0.06 - 0.02
    assert Governor(0.06, COSTS, 0.02, overlaps=True).place == 3
    assert Governor(0.03, COSTS, 0.025).place == 0  # there is nothing smaller
    # Without a rate to be kept it may take as long as the processing.
    assert Governor(0.03, COSTS, 0.025, generous=True).place == 1
    assert Governor(1.0, COSTS, 0.02, generous=True).place == 3


def test_a_search_that_takes_too_long_shrinks_and_grows_again() -> None:
    governor = Governor(0.05, COSTS, 0.01)

    def settled(slower: float, processing: float = 0.01) -> int:
        """The search chosen after many frames that took so many times their cost."""
        for _ in range(40):
            governor.revised(processing, slower * COSTS[governor.place])
        return governor.place

    assert governor.place == 2
    assert settled(1.1) == 2
    assert settled(2.0) == 0  # as on a busy machine
    assert settled(1.0) == 1
    assert settled(0.9, processing=0.0) == 2
    # One size is never left.
    single = Governor(0.05, COSTS[-1:], 0.01)
    assert not any(single.revised(0.01, seconds) for seconds in (5.0, 1e-6) for _ in range(30))


def test_errors_of_frames_and_of_when_poses_are_known() -> None:
    """Joints that move by 1 m/s at 10 frames/s, tracked 5 mm above: late by their way."""
    names, frames = EVALUATED_JOINTS, np.arange(20)
    joints = np.zeros((20, len(names), 3))
    joints[..., 0] = frames[:, None] / 10
    truth = JointSeries(names, joints, 10.0, frames)
    track = replace(truth, joints=joints[::4] + np.array([0, 0, 0.005]), frames=frames[::4])
    errors = live_errors(track, truth, np.array([0.12, 0.12, 0.0, 0.24, 9.0]))
    assert errors["error_mm"] == pytest.approx(5)
    late = [np.hypot(way, 5) for way in (120, 120, 0, 240)]  # the last has no truth
    assert errors["error_when_known_mm"] == pytest.approx(np.mean(late), abs=0.01)
    assert live_errors(track, truth, np.full(5, 9.0))["error_when_known_mm"] is None


def test_a_translation_moves_all_joints_alike() -> None:
    for body in (load_body("song31"), load_body("rymut31")):
        move = np.array([0.3, -0.2, 0.1])
        poses = body.rest_pose + np.stack([np.zeros(body.n_dof), translation(body) @ move])
        before, after = posed_joints(body, poses)
        np.testing.assert_allclose(after - before, np.tile(move, (len(before), 1)), atol=1e-9)


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


def test_smaller_footage(tmp_path: Path) -> None:
    sequence = Sequence.open(footage.native(tmp_path / "s", frames=2))
    smaller, frame = Smaller(sequence, 0.5), sequence.read(1)
    assert smaller.rig[0].size == (32, 24)
    small = smaller(frame)
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
    assert same(frame) is frame and same.background is sequence.background


def test_pictures_as_fine_as_voxels() -> None:
    rig = make_rig(SceneConfig(cameras=4))

    def grid(voxel_size: float) -> VoxelGrid:
        return VoxelGrid(np.array([0, 0, 1.0]), voxel_size, (2, 2, 2))

    pixel = finest_pixel(rig, grid(0.02))
    for voxel, factor in ((0.9, 1), (1.9, 1), (2.1, 0.5), (3.9, 0.5), (4.1, 0.25)):
        assert fitting_factor(rig, grid(voxel * pixel)) == factor


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
        with pytest.raises(InputError, match=message):
            cameras_of(folder, {}, names, 0.0).first()


@pytest.fixture(scope="module")
def filmed(walk: Path) -> Path:
    """The folder of a walk with body.toml and start.txt, fitted once for all tests."""
    found = given_start(walk, 0, None, walk / "truth.npz", "y-up")
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
    track, summary = Track.open(out), json.loads((out / "live.json").read_text())
    assert 1 <= len(track) == summary["results"] <= 5
    assert np.all(np.diff(track.frames) > 0) and track.fps == 60
    assert summary["sizes"] == [[0, 48, 6]]
    assert summary["error_mm"] < 80 and summary["lost"] == 0
    assert summary["error_when_known_mm"] is None or summary["error_when_known_mm"] > 0
    assert len(track) + sum(summary["dropped"].values()) <= 5
    assert "mean error" in capfd.readouterr().out


def test_videos_as_cameras(filmed: Path, tmp_path: Path) -> None:
    videos = [str(path) for path in sorted((filmed / "videos").iterdir())]
    more = ("--fps", "4", "--captures", *videos)
    assert live(filmed, tmp_path / "out", *more) == 0
    track = Track.open(tmp_path / "out")
    assert len(track) >= 1 and not track.lost.any()
    # The grid that follows the first pose holds the person.
    truth = np.load(filmed / "truth.npz")["joints"][-1]
    assert np.abs(track.joints[-1].mean(0) - truth.mean(0)).max() < 0.3
    chosen = json.loads((tmp_path / "out" / "live.json").read_text())["sizes"]
    assert all(FEWEST * 0.8 <= particles * layers <= MOST * 1.2 for _, particles, layers in chosen)


def prepared(folder: Path, objective: str = "voxel", follow: bool = False) -> Live:
    body = load_body(folder / "body.toml")
    pose = read_pose(folder / "start.txt", body)
    sequence = Sequence.open(folder)
    grid = automatic_grid(sequence, voxel_size=0.03) if objective == "voxel" else None
    searches = [Method.of("apf", objective, n_particles=n, n_layers=6) for n in (48, 96)]
    return Live(
        Device.best(), Replay(sequence, range(5)), grid, body, pose, searches, follow=follow
    )


def seen(run: Live, index: int, moved: float = 0.0) -> Observed:
    """A frame as the run's threads observe it, with voxels that are said to be elsewhere."""
    frame = run.source._sequence.read(index)  # type: ignore[attr-defined]
    observation, place = run._observe(frame)
    place = None if place is None else place + np.array([moved, 0, 0])
    return Observed(Shot(frame, index / 60), observation, place)


def tracked(run: Live, observed: Observed) -> Estimate:
    run._expect(observed)
    run._tracker.observe(observed.observation)
    return run._tracker.search()


def test_stopped_it_keeps_what_it_has(filmed: Path) -> None:
    run = prepared(filmed)

    def interrupt(result: object, timeline: Timeline) -> None:
        raise KeyboardInterrupt

    result = run.run(interrupt)
    assert len(result.frames) == len(result.estimates) == len(result.latencies) <= 5
    assert threading.active_count() < 20


def test_what_a_thread_raises_ends_the_run(filmed: Path, monkeypatch) -> None:
    run = prepared(filmed)

    def broken(frame: object) -> None:
        raise InputError("the picture is torn")

    monkeypatch.setattr(run, "_observe", broken)
    with pytest.raises(InputError, match="torn"):
        run.run()


def test_a_search_is_resized_where_it_stands(filmed: Path) -> None:
    run = prepared(filmed)
    run._governor.place = 0
    run._tracker = run._chosen()
    first = seen(run, 0)
    estimate = tracked(run, first)
    run._keep(first, estimate, 0.1)
    run._governor.place = 1
    run._tracker = run._chosen()
    assert run.result.sizes[-2:] == [(0, 48, 6), (1, 96, 6)]
    again = tracked(run, seen(run, 1))
    assert np.abs(again.pose - estimate.pose).max() < 0.5


@pytest.mark.parametrize("objective", ["voxel", "sp"])
def test_a_lost_pose_is_not_kept(filmed: Path, objective: str) -> None:
    run = prepared(filmed, objective)
    first = seen(run, 0)
    good = tracked(run, first)
    run._keep(first, good, 0.1)
    far = replace(good, pose=good.pose + 5, least_error=np.ones(6), misfit=2.0)
    second = seen(run, 1, moved=0.1)
    run._expect(second)
    run._keep(second, far, 0.1)
    assert [estimate.lost for estimate in run.result.estimates] == [False, True]
    # It moves with the voxels, where there are some.
    moved = run.result.estimates[1].pose - good.pose
    expected = run._translation @ [0.1 if objective == "voxel" else 0.0, 0.0, 0.0]
    np.testing.assert_allclose(moved, expected, atol=0.02)
    again = tracked(run, seen(run, 2))
    assert np.abs(again.pose - good.pose).max() < 0.5


def test_the_pose_moves_with_the_voxels(filmed: Path) -> None:
    """Without noise, the search begins where the voxels are said to have moved."""
    run = prepared(filmed)
    first = seen(run, 0)
    run._keep(first, tracked(run, first), 0.1)
    at = run.result.estimates[0].pose
    run._tracker.start(at)
    particles = run._tracker._particles
    diffuse = particles.diffuse(0, 0)
    run._expect(seen(run, 0, moved=0.2))
    particles.widen(0.0)
    diffuse()
    expected = at + run._translation @ [0.2, 0.0, 0.0]
    np.testing.assert_allclose(particles.sets[1].get()[0], expected, atol=2e-3)


@pytest.mark.parametrize(
    "more",
    [
        ["--fps", "0"],
        ["--scale", "2"],
        ["--device", "numpy"],
        ["--objective", "best"],
        ["--captures", "absent.mp4"],
        ["--truth", "absent.npz"],
        ["--height", "178"],
    ],
)
def test_bad_flags(more: list[str], filmed: Path, tmp_path: Path, capfd) -> None:
    assert live(filmed, tmp_path / "out", *more) == 2
    lines = capfd.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("apf: error: "), lines
    assert not (tmp_path / "out").exists()
