"""Starting a run from the page: its settings, its flags, its process and its results."""

import json
import shutil
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
import tomli_w
from helpers.commands import state_track, succeed
from helpers.waiting import wait_for
from scipy.spatial.transform import Rotation

pytest.importorskip("viser", reason="viser is not installed")

from apf.request import TrackRequest
from apf.studio.folders import Roots
from apf.studio.footage import FootageView
from apf.studio.opened import RunningTake, open_track
from apf.studio.page import Page
from apf.studio.run_panel import ChosenSettings
from apf.studio.watch import TrackWatch
from apf.studio.work import Work, WorkSlot, free_folder, state_flags
from apf.tracking.retracking import ERROR, list_corrections
from apf.tracking.track import Track
from cl import InputError, select_device
from psfs.common.files import read_toml
from psfs.common.requests import Stated, collect_settings
from psfs.page.clouds import CarvedClouds
from psfs.sequence import Sequence


def test_settings_are_those_of_the_tree() -> None:
    chosen = ChosenSettings()
    particles = ("method", "filter", "search", "n_particles")
    assert chosen.default(particles) == 200
    chosen.set(particles, "120")
    chosen.set(("method", "recover"), False)
    assert chosen.tables == {
        "method": {"filter": {"search": {"n_particles": 120}}, "recover": False}
    }
    for path, value in ((particles, "-3"), (particles, "many"), (particles, "1.5")):
        with pytest.raises(InputError, match=rf"n_particles is '?{value}'?; expected"):
            chosen.set(path, value)
    chosen.set(("method", "recover"), True)
    chosen.set(particles, "200")
    assert chosen.tables == {}
    assert len(chosen.fields) > 50  # all of them can be shown, and set to their defaults
    for path in chosen.fields:
        chosen.set(path, chosen.default(path))
    assert chosen.values == {}


def test_folders_of_runs_are_new(tmp_path: Path) -> None:
    assert free_folder(tmp_path, "../a <b>") == tmp_path / "a_b"
    (tmp_path / "walk").mkdir()
    assert free_folder(tmp_path, "walk") == tmp_path / "walk-2"
    assert free_folder(tmp_path, "..") == tmp_path / "run"


def request_of(folder: Path, tables: dict[str, Any] | None = None) -> TrackRequest:
    """Return a request to track a folder that does not exist."""
    values = {"folders": (folder / "gone",), "output": folder / "out"}
    return TrackRequest.from_stated(Stated(values, tables or {}))


def test_a_command_states_what_its_request_states(tmp_path: Path) -> None:
    words = [str(tmp_path / "a b"), f"--output={tmp_path}", "--frames=0:3", "--one-way"]
    words += ["--people=2", "--sync=cam01=3,cam02=0", "--volume=-1,1,-1,1,0,2", "--preset=song"]
    request = TrackRequest.from_stated(state_track(*words))
    again = TrackRequest.from_stated(state_track(*state_flags(request)))
    assert repr(again.stated) == repr(request.stated)
    assert collect_settings(again) == collect_settings(request)


@pytest.fixture(scope="module")
def take(small_walk: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("takes") / "walk <i>"
    return Path(shutil.copytree(small_walk, folder))


@pytest.fixture
def page(take: Path, tmp_path: Path) -> Iterator[Page]:
    made = Page(Roots(take), lambda: select_device("auto"), results=tmp_path / "results")
    yield made
    made.stop()


def test_footage_is_examined_and_its_silhouettes_are_drawn(page: Page, take: Path) -> None:
    page.open(take)
    footage = page.view
    assert isinstance(footage, FootageView)
    assert "walk &lt;i&gt;" in footage.remarks.content and "cam01" in footage.remarks.content
    wait_for(lambda: "examining" not in footage.remarks.content)
    assert footage.volume is None and ">whole<" in footage.remarks.content
    footage.drag_box(np.array([[0.9, -1.0, 2.0], [-1.0, 1.25, 0.0]]))
    assert footage.volume is not None
    assert np.allclose(footage.volume, [[-1.0, -1.0, 0.0], [0.9, 1.25, 2.0]])
    assert np.allclose([handle.position for handle in footage.box.handles], footage.volume)
    wait_for(lambda: footage._picture.image.shape[1] > 160)
    plain = footage._picture.image
    footage._opacity.value = 1.0
    wait_for(lambda: not np.array_equal(plain, footage._picture.image))
    changed = np.any(footage._picture.image != plain, axis=-1).mean()
    assert 0.005 < changed < 0.5  # the person, not the room


def test_page_tracks_corrects_and_takes_home(page: Page, take: Path, tmp_path: Path) -> None:
    """The first run in this process, the second one, with the corrections, as the page has it."""
    page.open(take)
    run = page.run
    for name, value in (("n_particles", 60), ("n_layers", 2)):
        run.settings.chosen.set(("method", "filter", "search", name), value)
    run.frames.value, run.fast.value = "0:3", True
    first = tmp_path / "results" / "walk_i"
    more = {
        "report": False, "video": False, "voxel_size": 0.05, "all_cameras": True,
        "init": take / "truth.npz", "output": first,
    }  # fmt: skip
    request = TrackRequest.from_stated(Stated(more).over(run.make_request().stated))
    assert request.method.filter.search.n_particles == 60
    settings = tmp_path / "settings.toml"
    settings.write_text(tomli_w.dumps(dict(request.stated.tables)))
    succeed("apf", "track", *state_flags(request), "--config", str(settings))
    page.roots.add(first)
    page.open(first)
    watch = page.view
    assert isinstance(watch, TrackWatch) and watch.opened.frames.tolist() == [0, 1, 2]
    watch.time_line.seek(1)
    track = watch.opened.track
    assert track is not None
    wrist, shoulder = map(track.joint_names.index, ("l_wrist", "l_shoulder"))
    page.correct.joint.value = "left wrist"
    page.correct.toggle_handle()
    arm = track.joints[1, wrist] - track.joints[1, shoulder]  # may be straight: it is swung
    goal = track.joints[1, shoulder] + Rotation.from_rotvec([0, 0.15, 0]).apply(arm)
    page.correct.move_handle(goal)
    tracked_wrist = np.asarray(watch.bodies[next(iter(watch.opened.tracks))].joints.points)[wrist]
    assert np.linalg.norm(tracked_wrist - goal) < 0.02  # the limb follows the handle
    page.correct.toggle_handle()
    watch.time_line.seek(2)
    page.correct.mark_bad()
    assert "left wrist" in page.correct.list.content and "frames 2" in page.correct.list.content
    page.correct.track_again()
    work = run.work
    assert work is not None
    wait_for(lambda: work.ended)
    assert work.succeeded, work.words
    wait_for(lambda: page.view not in (watch, None) and not run.slot.button.visible)
    assert isinstance(page.view, TrackWatch) and page.view.opened.frames.tolist() == [0, 1, 2]
    better = Track.open(work.output)
    off = np.linalg.norm(np.stack([t.joints[1, wrist] for t in (track, better)]) - goal, axis=1)
    assert off[1] < ERROR + 1e-3 < 0.5 * off[0]
    assert better.lost.tolist() == [False, False, True]
    assert any("left wrist" in line for line in list_corrections(better))
    path = work.output / "summary.json"
    summary = json.loads(path.read_text())
    assert any("corrected by hand in frame 1" in line for line in summary["says"])

    path.unlink()  # while a run goes on, there is none
    running = RunningTake(Sequence.open(take), request.reconstruction)
    so_far = open_track(work.output, lambda: select_device("auto"), running=running)
    assert so_far.sequence is running.sequence and not so_far.voxels_shown
    assert isinstance(so_far.clouds, CarvedClouds)
    so_far.clouds.want(True)
    wait_for(lambda: so_far.clouds.get(0) is not None)
    assert len(so_far.clouds.get(0).positions) > 20
    so_far.close()


def test_two_presses_start_one_run_whose_error_is_shown(tmp_path: Path) -> None:
    slot, barrier = WorkSlot(MagicMock()), threading.Barrier(4)
    started: list[Work] = []
    tables = {"method": {"recover": False}}

    def press(_: int) -> None:
        barrier.wait()
        try:
            started.append(slot.start(request_of(tmp_path, tables)))
        except InputError as error:
            assert "one at a time" in str(error)

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(press, range(4)))
    (work,) = started
    assert slot.work is work
    settings = Path(work.command[-1])
    assert read_toml(settings) == tables
    wait_for(lambda: work.ended)
    slot.close()
    assert not work.succeeded and work.describe() == "ended early"
    assert any("no such folder" in line for line in work.words), work.words
    assert not settings.exists()


def test_command_is_cancelled(page: Page, take: Path) -> None:
    """Also one that was started to ignore Ctrl-C, as by a shell in the background."""
    page.open(take)
    run = page.run
    usual = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        work = run.start(run.make_request())
    finally:
        signal.signal(signal.SIGINT, usual)
    running = run.find_running(work.output)
    assert running is not None and running.sequence.folder == take
    with pytest.raises(InputError, match="one at a time"):
        run.start(run.make_request())
    wait_for(lambda: work.describe() != "beginning")
    assert 0 <= work.share < 1
    work.cancel()
    wait_for(lambda: work.ended)
    work.close()
    assert not work.succeeded and work.describe() == "ended early"
    assert run.find_running(work.output) is None
