"""Several takes in one process: each as alone, none stopped by another's fault."""

from __future__ import annotations

import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import numpy as np
import pytest

import apf.tracking.pipeline
import apf.tracking.take
from apf.body.model import BodyModel
from apf.body.toml import load_body
from apf.cli import main
from apf.evaluation.evaluate import load_truth
from apf.filters.method import Method
from apf.initialisation.config import StartConfig
from apf.initialisation.from_joints import fit_to_joints
from apf.synthetic.generate import generate
from apf.synthetic.scene import SceneConfig
from apf.tracking.batch import run_at_once
from apf.tracking.settings import TakeSettings
from apf.tracking.take import Take, track_take
from apf.tracking.track import Track
from cl import Device, InputError, NumpyDevice
from psfs.common.outputs import MANIFEST
from psfs.sequence import Sequence
from psfs.session import Session, SessionSettings

Check = Callable[[], None]
FRAMES = 3
FLAGS = [
    "--particles",
    "40",
    "--layers",
    "3",
    "--voxel-size",
    "0.06",
    "--no-overlay",
    "--no-report",
    "--all-cameras",
]


# Doing several things at once ---------------------------------------------------------------------


def results(work: Callable[..., object], n_takes: int, n_at_once: int = 3) -> dict[int, object]:
    return dict(run_at_once(NumpyDevice(), work, n_takes, n_at_once))


def test_so_many_at_a_time_and_no_more() -> None:
    both, busy = threading.Barrier(2, timeout=10), []
    lock, most = threading.Lock(), [0]

    def work(device: NumpyDevice, number: int, check: Check) -> int:
        with lock:
            busy.append(number)
            most[0] = max(most[0], len(busy))
        both.wait()  # passes only if there are two
        with lock:
            busy.remove(number)
        return 10 * number

    assert results(work, 6, 2) == {number: 10 * number for number in range(6)}
    assert most == [2]


def test_each_has_a_queue_of_its_own(device: Device) -> None:
    seen = []

    def work(own: Device, number: int, check: Check) -> None:
        seen.append(own)

    list(run_at_once(device, work, 3, 2))
    queues = {one.queue.int_ptr for one in (device, *seen)}
    assert len(queues) == 4 and {one.context for one in seen} == {device.context}


def test_one_that_fails_stops_no_other() -> None:
    def work(device: NumpyDevice, number: int, check: Check) -> int:
        if number == 1:
            raise InputError("no pictures; expected some")
        return number

    found = results(work, 4)
    assert isinstance(found.pop(1), InputError) and found == {0: 0, 2: 2, 3: 3}


def test_a_mistake_of_ours_is_raised_and_ends_the_others() -> None:
    ended, both = [], threading.Barrier(2, timeout=10)

    def work(device: NumpyDevice, number: int, check: Check) -> None:
        both.wait()
        if number == 0:
            raise ZeroDivisionError
        until_checked(check, lambda: ended.append(number))

    with pytest.raises(ZeroDivisionError):
        results(work, 5, 2)
    assert ended == [1]  # and 2 to 4 were never begun


def interrupt() -> None:
    """As Ctrl-C does, out of any thread."""
    signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)


def until_checked(check: Check, then: Callable[[], object]) -> None:
    """Work on until `check` ends it, then do something."""
    try:
        for _ in range(1000):
            check()
            time.sleep(0.01)
    except KeyboardInterrupt:
        then()
        raise
    pytest.fail("nobody ended the work")


@pytest.mark.parametrize("where", ["main", "thread"])
def test_interrupts_reach_all_takes_in_work_and_no_other_is_begun(where: str) -> None:
    begun, both = [], threading.Barrier(2, timeout=10)

    def work(device: NumpyDevice, number: int, check: Check) -> str:
        begun.append(number)
        both.wait()
        if number == 0:
            if where == "thread":
                raise KeyboardInterrupt
            interrupt()
        with suppress(KeyboardInterrupt):
            until_checked(check, lambda: None)
        return "what there is"

    found = []
    with pytest.raises(KeyboardInterrupt):
        found.extend(run_at_once(NumpyDevice(), work, 5, 2))
    assert sorted(begun) == [0, 1]


def test_closing_ends_the_work() -> None:
    begun, ended = [], []

    def work(device: NumpyDevice, number: int, check: Check) -> int:
        begun.append(number)
        if number:
            until_checked(check, lambda: ended.append(number))
        return number

    with closing(run_at_once(NumpyDevice(), work, 4, 2)) as outcomes:
        assert next(outcomes) == (0, 0)
    assert 3 not in begun and sorted(ended) == sorted(begun)[1:]


# Takes --------------------------------------------------------------------------------------------


@pytest.fixture(scope="session")  # workers come back to this file
def walks(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Takes of different people in rigs of different size."""
    folder = tmp_path_factory.mktemp("walks")
    for seed, cameras in ((4, 4), (5, 3), (6, 4)):
        size = (160, 120) if cameras == 4 else (128, 96)
        config = SceneConfig(
            cameras=cameras, frames=FRAMES, fps=60, size=size, seed=seed, height=1.5 + seed / 20
        )
        generate(folder / f"walk{seed}", config, Device.best())
    return sorted(folder.iterdir())


@cache
def fitted(truth: bytes) -> tuple[BodyModel, np.ndarray]:
    with TemporaryDirectory() as folder:
        path = Path(folder, "truth.npz")
        path.write_bytes(truth)
        joints = load_truth(path)
    first = dict(zip(joints.joint_names, joints.joints[0], strict=True))
    body, pose, _ = fit_to_joints(load_body("song31"), first)
    return body, pose


@pytest.fixture
def true_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Starts from the true joints, for the search (which test_start.py tests) takes its time."""

    def start(session: Session, *_: object, **__: object) -> object:
        body, pose = fitted((session.sequence.folder / "truth.npz").read_bytes())
        return SimpleNamespace(
            body=body, pose=pose, registration_error=0.25, doubts=["he is seen twice"],
            config=StartConfig(),
        )  # fmt: skip

    monkeypatch.setattr(apf.tracking.take, "initialise", start)


def test_takes_are_bit_by_bit_those_alone(
    device: Device, walks: list[Path], true_starts: None
) -> None:
    method = Method.create(n_particles=40, n_layers=3, seed=3)
    settings = TakeSettings(method=method, seeds=(3, 4))
    told = []

    def take_of(own: object, number: int, check: object = None) -> Take:
        session_settings = SessionSettings(voxel_size=0.06)
        session = Session(Sequence.open(walks[number]), own, session_settings)  # type: ignore[arg-type]
        return track_take(session, settings, lambda stage: told.append((number, stage)))

    together = dict(run_at_once(device, take_of, 2, 2))
    told_together = told.copy()
    assert sorted(together) == [0, 1]
    for number in range(2):
        mine, alone = together[number], take_of(device, number)
        assert isinstance(mine, Take) and len(mine.tracks) == 2
        for a, b in zip(mine.tracks, alone.tracks, strict=True):
            assert len(a) == FRAMES and a.provenance == b.provenance
            np.testing.assert_array_equal(a.poses, b.poses)
            np.testing.assert_array_equal(a.covariance, b.covariance)
        stages = [stage for n, stage in told_together if n == number and stage != "start"]
        forward_and_back = ["tracking"] * FRAMES + ["tracking back"] * FRAMES
        assert stages == ["volume", "preparing", *forward_and_back]
    assert np.any(together[0].tracks[0].poses != together[1].tracks[0].poses)


def test_given_starts_and_image_objectives_need_no_voxels(walks: list[Path]) -> None:
    body = load_body("song31")
    method = Method.create("pso", "sp", n_particles=40, n_layers=2)
    told = []
    settings = SessionSettings(selection=slice(1, 3))
    session = Session(Sequence.open(walks[0]), Device.best(), settings)
    given = TakeSettings(method=method, given=(body, body.rest_pose))
    take = track_take(session, given, told.append)
    assert take.start is None and take.seconds > 0 and told == ["preparing", "tracking", "tracking"]
    assert take.tracks[0].frames.tolist() == [1, 2]


# The command --------------------------------------------------------------------------------------


def test_the_command_tracks_every_take_and_names_those_that_failed(
    walks: list[Path], tmp_path: Path, true_starts: None, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(walks[2], broken)
    (broken / "videos" / "cam01.mp4").unlink()
    folders = [str(folder) for folder in (walks[0], broken, walks[1], tmp_path / "absent")]
    out = tmp_path / "out"
    assert main(["track", *folders, "-o", str(out), *FLAGS]) == 2
    said = capsys.readouterr()
    assert said.err.splitlines()[-1] == "apf: error: 2 of 4 takes failed: broken, absent"
    assert f"{walks[1].name}: he is seen twice" in said.err
    assert {path.name for path in out.iterdir()} == {walks[0].name, walks[1].name, MANIFEST}
    rows = [line for line in said.out.splitlines() if line.startswith("│ ")]
    cells = {row.split("│")[1].strip(): [c.strip() for c in row.split("│")[2:]] for row in rows}
    assert cells[walks[0].name][0] == str(FRAMES) and float(cells[walks[0].name][1]) > 0
    assert cells[walks[0].name][2:4] == ["0", "0.25"]
    assert cells["broken"][5] == "failed" and "broken failed: " in said.out
    alone = tmp_path / "alone"
    assert main(["track", folders[0], "-o", str(alone), *FLAGS]) == 0
    for name in ("track.npz", "joints.trc", "joints.csv", "body.toml", "start.txt"):
        assert (out / walks[0].name / name).read_bytes() == (alone / name).read_bytes(), name
    names = [{path.name for path in folder.iterdir()} for folder in (alone, out / walks[0].name)]
    assert names[0] == names[1] and len(names[0]) == 8


def test_several_seeds_of_several_takes(
    walks: list[Path], tmp_path: Path, true_starts: None, capsys: pytest.CaptureFixture[str]
) -> None:
    folders = [str(folder) for folder in walks[:2]]
    few = ["--seeds", "2", "--frames", "0:2", "--at-once", "1"]
    assert main(["track", *folders, "-o", str(tmp_path), *FLAGS, *few]) == 0
    written = {path.parent.relative_to(tmp_path) for path in tmp_path.rglob("track.npz")}
    assert written == {Path(f.name, s) for f in walks[:2] for s in ("seed0", "seed1")}
    said = capsys.readouterr().out
    for folder in walks[:2]:
        assert f"{folder.name}: 2 runs: joints lie" in said


def test_interrupted_takes_leave_whole_results(
    walks: list[Path],
    tmp_path: Path,
    true_starts: None,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    real = apf.tracking.pipeline.observe_frames

    def interrupting(observe: object, frames: Iterator) -> Iterator:
        for number, seen in enumerate(real(observe, frames)):
            if number == 1:
                interrupt()
                time.sleep(0.5)  # the main thread has to notice
            yield seen

    monkeypatch.setattr(apf.tracking.pipeline, "observe_frames", interrupting)
    folders = [str(folder) for folder in walks]
    assert main(["track", *folders, "-o", str(tmp_path), *FLAGS, "--at-once", "1"]) == 130
    said = capsys.readouterr()
    assert {path.name for path in tmp_path.iterdir()} == {walks[0].name, MANIFEST}
    assert Track.open(tmp_path / walks[0].name).frames.tolist() == [0, 1]
    assert f"2 of {FRAMES}" in said.out and said.out.count("not tracked") == 2
    assert said.err.splitlines()[-1] == "apf: interrupted"


def test_takes_of_one_name_are_told_apart(
    walks: list[Path], tmp_path: Path, true_starts: None
) -> None:
    days = [tmp_path / day / "walk" for day in ("monday", "tuesday")]
    for day, folder in zip(days, walks, strict=False):
        shutil.copytree(folder, day)
    out = tmp_path / "out"
    assert main(["track", *map(str, days), "-o", str(out), *FLAGS]) == 0
    assert {path.name for path in out.iterdir()} == {"monday_walk", "tuesday_walk", MANIFEST}


@pytest.mark.parametrize(
    ("more", "match"),
    [
        (["{b}/../walk4"], "given twice"),
        (["{b}", "--init", "{b}/truth.npz"], "--init is the first pose of one take"),
        (["{b}", "--at-once", "0"], "--at-once is 0"),
    ],
)
def test_what_several_takes_cannot_be_asked(
    more: list[str],
    match: str,
    walks: list[Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = [word.format(b=walks[1]) for word in more]
    assert main(["track", str(walks[0]), *words, "-o", str(tmp_path / "out")]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and match in lines[0], lines
    assert not (tmp_path / "out").exists()
