"""Live tracking: the session, and the whole of it from the command line."""

import json
import shutil
import threading
import time
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import tracks
from helpers.commands import fail, succeed

from apf.body.kinematics import posed_joints
from apf.body.toml import load_body
from apf.cli import live as live_command
from apf.cli.live import compare_with_truth
from apf.evaluation.truth import load_people_truth
from apf.filters.base import Estimate
from apf.filters.method import Method
from apf.formats.pose import read_pose
from apf.live.cameras import LiveCamera
from apf.live.config import LiveConfig
from apf.live.people import make_translation_matrix
from apf.live.session import Live, LiveResult, LiveStart, ObservedFrame
from apf.live.sources import Replay, Shot
from apf.live.timeline import Timeline
from apf.tracking.track import Track
from cl import Device, InputError
from psfs.sequence import Frame, Sequence
from psfs.session import Session, SessionSettings
from psfs.volume import automatic_grid
from psfs.voxels.grid import VoxelGrid

SIZES = LiveConfig()
FEW = ["--particles", "48", "--layers", "6"]


def test_a_translation_moves_all_joints_alike() -> None:
    for body in (load_body("song31"), load_body("rymut31")):
        move = np.array([0.3, -0.2, 0.1])
        moved = body.rest_pose + make_translation_matrix(body) @ move
        before, after = posed_joints(body, np.stack([body.rest_pose, moved]))
        np.testing.assert_allclose(after - before, np.tile(move, (len(before), 1)), atol=1e-9)


@pytest.fixture(scope="module")
def filmed(walk: Path, fitted: Path) -> Path:
    """The folder of a walk with body.toml and start.txt."""
    return Path(shutil.copytree(fitted, walk, dirs_exist_ok=True))


def list_videos(folder: Path) -> list[str]:
    return [str(path) for path in sorted((folder / "videos").iterdir())]


def live(folder: Path, out: Path, *more: str) -> list[str]:
    """The words of a command."""
    start = ["--body", str(folder / "body.toml"), "--init", str(folder / "start.txt")]
    return ["apf", "live", str(folder), "-o", str(out), *start, *FEW, *more]


def test_a_recording_from_the_command_line(filmed: Path, tmp_path: Path, monkeypatch) -> None:
    """Takes that were recorded have folders, but for one that no pose was in."""
    run = live_command._run

    def run_with_takes(*given) -> tuple[LiveResult, list[tuple[int, int]]]:
        result, _ = run(*given)
        middle = result.frames[len(result.frames) // 2]
        return result, [(middle, result.frames[-1]), (10**6, 10**6)]

    monkeypatch.setattr(live_command, "_run", run_with_takes)
    out = tmp_path / "out"
    said = succeed(*live(filmed, out, "--truth", str(filmed / "truth.npz")))
    names = {path.name for path in out.iterdir()}
    assert names >= {"track.npz", "joints.trc", "joints.csv", "live.json", "timeline.png"}
    track, summary = Track.open(out), json.loads((out / "live.json").read_text())
    assert 1 <= len(track) == summary["results"] <= 4 - sum(summary["dropped"].values())
    assert np.all(np.diff(track.frames) > 0) and track.fps == 60
    assert summary["sizes"] == [[0, 48, 6]]
    assert summary["error_mm"] < 80 and summary["lost"] == 0
    assert "mean error" in said.out and "poses per second can be found" in said.err
    take, recorded = Track.open(out / "take1"), track.frames >= track.frames[len(track) // 2]
    np.testing.assert_array_equal(take.frames, track.frames[recorded])
    np.testing.assert_array_equal(take.poses, track.poses[recorded])
    assert not (out / "take2").exists()


def test_videos_as_cameras(filmed: Path, tmp_path: Path) -> None:
    videos = ["--captures", *list_videos(filmed)]
    succeed(*[w for w in live(filmed, tmp_path / "out", "--fps", "4", *videos) if w not in FEW])
    track = Track.open(tmp_path / "out")
    assert len(track) >= 1 and not track.lost.any()
    # The grid that follows the first pose holds the person.
    truth = np.load(filmed / "truth.npz")["joints"][-1]
    assert np.abs(track.joints[-1].mean(0) - truth.mean(0)).max() < 0.3
    chosen = json.loads((tmp_path / "out" / "live.json").read_text())["sizes"]
    low, high = SIZES.fewest * 0.8, SIZES.most * 1.2
    assert all(low <= particles * layers <= high for _, particles, layers in chosen)


@cache
def find_grid(folder: Path) -> VoxelGrid:
    session = Session(Sequence.open(folder), Device.best(), SessionSettings(voxel_size=0.03))
    return automatic_grid(session)


def prepared(folder: Path, objective: str = "voxel") -> Live:
    body = load_body(folder / "body.toml")
    pose = read_pose(folder / "start.txt", body)
    start = LiveStart(find_grid(folder) if objective == "voxel" else None, [(body, pose)])
    searches = [Method.create("apf", objective, n_particles=n, n_layers=6) for n in (48, 96)]
    return Live(Device.best(), Replay(Sequence.open(folder), range(4)), start, searches)


def seen(run: Live, index: int, moved: float = 0.0) -> ObservedFrame:
    """A frame as the run's threads observe it, with voxels that are said to be elsewhere."""
    frame = run.source.sequence.read(index)
    ((observation, centre),) = run.observe(frame, index / 60)
    run.processor.finish()
    centre = None if centre is None else centre + np.array([moved, 0, 0])
    return ObservedFrame(Shot(frame, index / 60), [(observation, centre)])


def tracked(run: Live, observed: ObservedFrame) -> Estimate:
    run.expect(observed)
    tracker = run.persons[0].tracker
    tracker.observe(observed.seen[0][0])
    tracker.enqueue_search()
    return tracker.fetch_estimate()()


def test_stopped_it_keeps_what_it_has(filmed: Path) -> None:
    run = prepared(filmed)

    def interrupt(result: object, timeline: Timeline) -> None:
        raise KeyboardInterrupt

    result = run.run([interrupt])
    assert len(result.frames) == len(result.estimates) == len(result.latencies) <= 4
    assert threading.active_count() < 20


def film(
    monkeypatch: pytest.MonkeyPatch,
    filmed: Path,
    left: dict[str, int],
    n_pictures: int,
    back_after: int = 10**6,
) -> list[str]:
    """Have the walk's videos give their first picture as cameras do, `n_pictures` times and until
    15 poses are found, however slow the machine is; those in `left` are gone after so many, and
    come back after another camera's picture `back_after`. Return their paths."""
    lost: list[LiveCamera] = []
    kept: list[ObservedFrame] = []
    keep, until = Live.keep, time.monotonic() + 120
    pictures = dict(zip(list_videos(filmed), Sequence.open(filmed).read(0).images, strict=True))

    def next_picture(camera: LiveCamera, after: int) -> tuple[int, float, np.ndarray | None]:
        if after >= left.get(Path(camera.name).stem, 10**6):
            lost.append(camera)
            raise camera.lose("it was unplugged")
        if after >= back_after and lost:
            back = lost.pop()
            left.pop(Path(back.name).stem)
            back._count += 1
        time.sleep(0.001)
        more = len(kept) < 15 and time.monotonic() < until
        picture = pictures[camera.name] if after < n_pictures or more else None
        return after + 1, time.perf_counter(), picture

    def counted(run: Live, observed: ObservedFrame, *more: Any) -> None:
        keep(run, observed, *more)
        kept.append(observed)

    monkeypatch.setattr(Live, "keep", counted)
    monkeypatch.setattr(LiveCamera, "next", next_picture)
    monkeypatch.setattr(LiveCamera, "play", lambda camera: None)
    return list(pictures)


def test_with_one_camera_left_the_run_ends(filmed: Path, tmp_path: Path, monkeypatch) -> None:
    names = film(monkeypatch, filmed, dict.fromkeys(["cam01", "cam02", "cam03"], 12), 40)
    said = fail(*live(filmed, tmp_path / "out", "--captures", *names))
    assert "too few cameras are left" in " ".join(said.split())
    track = Track.open(tmp_path / "out")
    assert len(track) > 0 and not track.lost.all()
    assert not list((tmp_path / "out").glob("parts/*"))


def test_a_camera_that_goes_and_comes_back(filmed: Path, tmp_path: Path, monkeypatch) -> None:
    names = film(monkeypatch, filmed, {"cam03": 12}, 60, back_after=40)
    ended = succeed(*live(filmed, tmp_path / "out", "--captures", *names))
    said = " ".join(ended.err.split())
    gone, back = (said.index(words) for words in ("gives no more pictures", "gives pictures again"))
    assert gone < back and "cam03" not in said[gone:back].partition("goes on with")[2][:30]
    assert said[:gone].endswith("cam03.mp4 ") and "cam03" in said[back:]
    assert "it was unplugged; the run goes on with" in said[gone:back]
    track = Track.open(tmp_path / "out")
    assert len(track) > 12 and not track.lost.all()


def test_poses_stay_on_disk_when_it_is_full(filmed: Path, tmp_path: Path, monkeypatch) -> None:
    """In parts that can be joined."""

    def full(*_: object) -> None:
        raise InputError("joints.trc: cannot be written: No space left on device")

    monkeypatch.setattr(live_command, "PART_SECONDS", 0.0)
    monkeypatch.setattr(live_command, "write_people", full)
    names = film(monkeypatch, filmed, {}, 20)
    said = fail(*live(filmed, tmp_path / "out", "--captures", *names))
    folder = tmp_path / "out" / "parts"
    assert f"what was tracked is in {folder}" in said
    parts = [Track.open(path) for path in sorted(folder.iterdir())]
    assert len(parts) > 1
    assert len({part.diagnostics["ess"].shape[1:] for part in parts}) == 1
    frames = np.concatenate([part.frames for part in parts])
    np.testing.assert_array_equal(Track.open(tmp_path / "out").frames, frames)
    assert np.all(np.diff(frames) > 0)


def test_results_do_not_go_among_the_background_that_is_read(filmed: Path) -> None:
    before = sorted((filmed / "background").iterdir())
    captures = ["--captures", *list_videos(filmed)]
    assert "which is read" in fail(*live(filmed, filmed / "background", *captures))
    assert sorted((filmed / "background").iterdir()) == before


def test_what_a_thread_raises_ends_the_run(filmed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = prepared(filmed)

    def broken(frame: object, time: float) -> None:
        raise InputError("the picture is torn")

    monkeypatch.setattr(run, "observe", broken)
    result = run.run()
    assert isinstance(result.error, InputError) and "torn" in str(result.error)


def test_frames_are_observed_in_their_turn(filmed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a GPU: all observations lie in one place, where the last frame's are."""
    run, there, observed = prepared(filmed), [-1], list[tuple[int, int]]()

    def acquire() -> None:
        for index in range(10_000):  # until enough were observed, however slow the machine is
            if len(observed) > 9 or run._stop.is_set():
                break
            run._shots.put(Shot(Frame(index, None, None), run.timeline.now()))
            time.sleep(0.001)
        run._shots.close()

    def observe(frame: Frame, at: float) -> list[int]:
        there[0] = frame.index
        time.sleep(0.002)
        return [frame.index]

    def observe_people(seen: list[int]) -> None:
        time.sleep(0.001)  # in which the processing must not begin with another frame
        observed.append((seen[0], there[0]))

    changes = {"_overlaps": True, "_acquire": acquire, "observe": observe}
    changes |= {"_observe_people": observe_people, "search": lambda: time.sleep(0.004)}
    for name, change in (changes | dict.fromkeys(("expect", "keep"), lambda *_: None)).items():
        monkeypatch.setattr(run, name, change)
    run.run()
    assert len(observed) > 9
    assert all(frame == place for frame, place in observed), observed


def test_a_search_is_resized_where_it_stands(filmed: Path) -> None:
    run = prepared(filmed)
    run.governor.chosen = 0
    run.start_selected()
    first = seen(run, 0)
    estimate = tracked(run, first)
    run.keep(first, [estimate], 0.1)
    run.governor.chosen = 1
    run.start_selected()
    assert run.result.sizes[-2:] == [(0, 48, 6), (1, 96, 6)]
    again = tracked(run, seen(run, 1))
    assert np.linalg.norm(again.joints - estimate.joints, axis=1).mean() < 0.04


@pytest.mark.parametrize("objective", ["voxel", "sp"])
def test_a_lost_pose_is_not_kept(filmed: Path, objective: str) -> None:
    run = prepared(filmed, objective)
    first = seen(run, 0)
    good = tracked(run, first)
    run.keep(first, [good], 0.1)
    far = replace(good, pose=good.pose + 5, least_error=np.ones(6), misfit=2.0)
    second = seen(run, 1, moved=0.1)
    run.expect(second)
    run.keep(second, [far], 0.1)
    assert [estimate.lost for (estimate,) in run.result.estimates] == [False, True]
    # It moves with the voxels, where there are some.
    moved = run.result.newest[0].pose - good.pose
    step = np.array([0.1 if objective == "voxel" else 0.0, 0.0, 0.0])
    expected = make_translation_matrix(run.persons[0].body) @ step
    np.testing.assert_allclose(moved, expected, atol=0.03)  # half a voxel more: noisy videos
    again = tracked(run, seen(run, 2))
    assert np.abs(again.pose - good.pose).max() < 0.5


def test_the_pose_moves_with_the_voxels(filmed: Path) -> None:
    """Without noise, the search begins where the voxels are said to have moved."""
    run = prepared(filmed)
    first = seen(run, 0)
    run.keep(first, [tracked(run, first)], 0.1)
    at = run.result.newest[0].pose
    tracker = run.persons[0].tracker
    tracker.start(at)
    particles = tracker.particles
    diffuse = particles.diffuse(0, 0)
    moved = seen(run, 0, moved=0.2)
    run.expect(moved)
    particles.widen(0.0)
    diffuse()
    step = moved.seen[0][1] - first.seen[0][1]  # with what a second look at the frame changes
    np.testing.assert_allclose(step, [0.2, 0.0, 0.0], atol=0.02)
    expected = at + make_translation_matrix(run.persons[0].body) @ step
    np.testing.assert_allclose(particles.sets[1].get()[0], expected, atol=2e-3)


def test_two_people_have_a_tracker_each(filmed: Path) -> None:
    """Who stands where nobody is has no voxels, is lost, and takes none of the other's."""
    run = prepared(filmed)
    alone = seen(run, 0).seen[0]
    body, pose = run.persons[0].body, run.persons[0].pose
    aside = pose + make_translation_matrix(body) @ [1.2, 0.0, 0.0]
    start = LiveStart(find_grid(filmed), [(body, pose), (body, aside)])
    search = Method.create("apf", "voxel", n_particles=48, n_layers=6)
    both = Live(run.device, run.source, start, [search])
    first, second = both.observe(run.source.first(), 0.0)
    both.processor.finish()
    count = [int(part.count.get()[0]) for part in (alone[0], first[0], second[0])]
    assert count[2] < 0.05 * count[0] < 0.9 * count[0] < count[1]
    observed = ObservedFrame(Shot(run.source.first(), 0.0), [first, second])
    both.expect(observed)
    for person, (shown, _) in zip(both.persons, observed.seen, strict=True):
        person.tracker.observe(shown)
    both.keep(observed, both.search(), 0.1)
    assert [estimate.lost for estimate in both.result.newest] == [False, True]
    assert [len(each) for each in both.result.estimates] == [2]
    np.testing.assert_allclose(both.result.newest[1].pose, aside, atol=1e-6)


def test_several_people_need_voxels_and_a_volume(filmed: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    said = fail(*live(filmed, out, "--people", "2", "--objective", "sp"))
    assert "--objective sp tracks one person" in said
    truth = dict(np.load(filmed / "truth.npz"))
    joints = np.stack([truth["joints"], truth["joints"] + [1.0, 0.0, 0.0]], 1)
    late = {"joints": joints, "frames": 9 + np.arange(4)}
    for changed, expected in (
        ({"joints": joints}, "expected --volume that holds all people"),
        (late, "start.npz: holds nobody's joints in frame 0"),
    ):
        np.savez(tmp_path / "start.npz", **{**truth, **changed})
        flags = ["--people", "2", "--init", str(tmp_path / "start.npz"), "--captures"]
        said = fail("apf", "live", filmed, "-o", out, *flags, *list_videos(filmed))
        assert expected in said


def test_one_is_compared_with_the_nearest(tmp_path: Any) -> None:
    track = tracks.walker(4)
    joints = np.stack([track.joints + np.array([x, 0, 0]) for x in (1.0, 0.01)], axis=1)
    path = tmp_path / "truth.npz"
    np.savez(path, joint_names=np.array(track.joint_names), joints=joints, fps=track.fps)
    result = LiveResult(latencies=[0.0] * 4)
    errors = compare_with_truth([track], result, load_people_truth(path))
    assert errors["error_mm"] == pytest.approx(10, abs=0.01)
