"""Tasks on workers that die, raise and are stopped; many takes by the command."""

import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest
from helpers.commands import fail, succeed
from helpers.tasks import die_until, double, hang, interrupted, raise_until, wait_for_stop

from apf.cluster.connection import DaskPool, connect_cluster
from apf.cluster.processes import Processes, Task
from apf.cluster.task_side import Progress, TaskStopped
from apf.cluster.workers import Share, share_machine
from apf.tracking.track import Track
from cl import InputError
from psfs.common.system import list_own_cores


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """Yield a client of a cluster of a worker that may die: Dask may fail to start it again if it
    died within its first moments."""
    distributed = pytest.importorskip("distributed")
    dask = pytest.importorskip("dask")
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(1, threads_per_worker=1, dashboard_address=None) as cluster,
        connect_cluster(cluster.scheduler_address, Path()) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def processes() -> Iterator[Processes]:
    """Yield two workers of this machine, both pinned to the first core."""
    with Processes([Share("cpu", tuple(list_own_cores()[:1]))] * 2) as pool:
        yield pool


def test_nothing_listens(processes: Processes) -> None:
    """Nobody but the command speaks to its workers."""
    for worker in processes._workers:
        found = psutil.Process(worker.process.pid).net_connections()
        assert [one for one in found if one.status == psutil.CONN_LISTEN] == []


@pytest.mark.parametrize("where", ["processes", "client"])
def test_tasks_have_outcomes(where: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    """Two failures are survived, three deaths or failures are not; other tasks are unaffected."""
    said: list[Progress] = []
    pool = request.getfixturevalue(where)
    if where == "client":
        pool = DaskPool(pool, said.append)
    else:
        pool._on_progress = said.append
    tasks = [
        Task(name, raise_until, (str(tmp_path / name), times))
        for name, times in (("raises twice", 2), ("raises", 9))
    ]
    tasks += [Task(f"double {number}", double, (number,)) for number in range(3)]
    tasks.append(Task("interrupted", interrupted))
    found = dict(pool.outcomes((task.name, partial(pool.run, task)) for task in tasks))
    assert found.pop("raises twice") == 3
    raised = found.pop("raises")
    assert isinstance(raised, InputError) and str(raised) == "attempt 3"
    assert type(found.pop("interrupted")).__name__ == "TaskStopped"
    assert [outcome[0] for outcome in found.values()] == [0, 2, 4]
    if where == "processes":  # of Dask: see the last test
        assert {outcome[1:] for outcome in found.values()} == {(1, "1")}
        with pytest.raises(InputError, match=" died"):
            pool.run(Task("dies", die_until, (str(tmp_path / "dies"), 9)))
        assert pool.run(Task("double", double, (3,)))[0] == 6
    assert {p.stage for p in said} == {"doubling"} and said[0].total == 1


def test_a_task_that_hangs_is_ended(processes: Processes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("apf.cluster.processes._SILENCE", 0.1)
    monkeypatch.setattr("apf.cluster.processes.ATTEMPTS", 1)
    with pytest.raises(InputError, match="hangs"):
        processes.run(Task("hangs", hang))


def test_a_job_goes_on_with_what_came_before(processes: Processes, tmp_path: Path) -> None:
    def sum_of(numbers: list[int]) -> int:
        parts = processes.run_all([Task(f"{n} of {numbers}", double, (n,)) for n in numbers])
        return processes.run(Task(f"all of {numbers}", double, (sum(p[0] for p in parts),)))[0]

    def failing() -> None:
        fails = Task("fails", raise_until, (str(tmp_path / "fails"), 9))
        processes.run_all([fails, Task("beside it", double, (1,))])
        raise AssertionError("it goes no further")

    jobs = {"a": partial(sum_of, [1, 2, 3]), "b": failing, "c": partial(sum_of, [4])}
    found = dict(processes.outcomes(jobs.items()))
    assert found["a"] == 24 and found["c"] == 16 and isinstance(found["b"], InputError)


def test_stopped_takes_write_what_they_have(processes: Processes, tmp_path: Path) -> None:
    """Then their workers end by themselves; the last of these tests, as nothing runs after it."""
    begun = threading.Event()
    processes._on_progress = lambda _: begun.set()
    task = Task("waits", wait_for_stop, (str(tmp_path / "file"),))
    with ThreadPoolExecutor() as threads:
        waiting = threads.submit(processes.run, task)
        assert begun.wait(120)
        processes.stop()
        with pytest.raises(TaskStopped):
            waiting.result()
    assert all(worker.process.exitcode != -signal.SIGKILL for worker in processes._workers)
    assert (tmp_path / "file").read_text() == "frames so far"


@pytest.mark.parametrize("where", ["processes", "client"])
def test_the_command(
    where: str,
    small_walk: Path,
    fitted: Path,
    tmp_path: Path,
    request: pytest.FixtureRequest,
) -> None:
    """Takes of a list on workers, here or of a cluster: as `apf track` has them; a bad one stops
    none; a second call does what is left."""
    (tmp_path / "bad").mkdir()
    take = f"""
        [defaults]
        particles = 40
        layers = 3
        one_way = true
        voxel-size = 0.06
        frames = "0:2"
        all-cameras = true
        no_overlay = true
        no_report = true
        body = "{fitted / "body.toml"}"
        init = "{fitted / "start.txt"}"
        [[take]]
        folder = "{small_walk}"
        name = "second"
        frames = "0:1"
        seed = 4
        """
    (tmp_path / "sound.toml").write_text(take)
    (tmp_path / "takes.toml").write_text(f'{take}\n[[take]]\nfolder = "bad"\n')
    out = tmp_path / "out"
    more = ["-o", str(out), "--to", "trc"]
    if where == "client":
        more += ["--scheduler", request.getfixturevalue("client").scheduler.address]
    else:
        more += ["--workers", "1"]
    assert "1 of 2 takes failed: bad" in fail("apf", "batch", tmp_path / "takes.toml", *more)
    assert (out / "logs" / "bad.log").read_text().count("error: ") == 3
    if where == "client":
        return

    flags = [
        "--particles",
        "40",
        "--layers",
        "3",
        "--voxel-size",
        "0.06",
        "--all-cameras",
        "--one-way",
        "--seed",
        "4",
    ]
    flags += ["--frames", "0:1", "--no-overlay", "--no-report"]
    flags += ["--body", str(fitted / "body.toml"), "--init", str(fitted / "start.txt")]
    succeed("apf", "track", small_walk, "-o", tmp_path / "alone", *flags)
    alone, mine = Track.open(tmp_path / "alone"), Track.open(out / "second")
    assert mine.poses.tobytes() == alone.poses.tobytes() and mine.frames.tolist() == [0]

    stamp = (out / "second" / "track.npz").stat().st_mtime_ns
    said = succeed("apf", "batch", tmp_path / "sound.toml", *more).out
    assert "1 of 1 takes done, 1 of them before" in said
    assert (out / "second" / "joints.trc").is_file()
    assert (out / "second" / "track.npz").stat().st_mtime_ns == stamp
    assert {p.name for p in out.iterdir()} >= {"index.html", "logs", "second", "takes.csv"}


def test_cluster_workers_die(client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The last test of the cluster: Dask may fail to start its worker again."""
    pool = DaskPool(client)
    with pytest.raises(InputError, match=" died"):
        pool.run(Task("dies", die_until, (str(tmp_path / "dies"), 9)))
    monkeypatch.setattr("apf.cluster.connection._LOOK", 0.1)
    monkeypatch.setattr("apf.cluster.connection._PATIENCE", 0.2)
    monkeypatch.setattr(pool, "count_workers", lambda: 0)
    with pytest.raises(InputError, match=r"no worker for 0\.2 s"):
        pool.run(Task("waits", hang))


def test_workers_share_the_cores() -> None:
    cores = list_own_cores()
    assert share_machine("cpu") == [Share("cpu", (core,)) for core in cores]
    assert share_machine("cpu", 1) == [Share("cpu", tuple(cores))]
    assert share_machine("cpu")[0].environment["OPENCV_FOR_THREADS_NUM"] == "1"
    more = share_machine("numpy", 2 * len(cores))
    assert [share.cores for share in more] == [(c,) for c in cores] + [tuple(cores)] * len(cores)
    with pytest.raises(InputError, match="--workers is 0"):
        share_machine("cpu", 0)


@pytest.mark.parametrize(
    ("n_cores", "n_gpus", "expected"), [(16, 1, 8), (32, 2, 16), (12, 2, 6), (2, 4, 4), (128, 1, 8)]
)
def test_gpus_get_as_many_workers_as_cores_feed(
    monkeypatch: pytest.MonkeyPatch, n_cores: int, n_gpus: int, expected: int
) -> None:
    gpu = SimpleNamespace(is_gpu=True, kind="gpu")
    monkeypatch.setattr("apf.cluster.workers.select_device", lambda choice: gpu)
    monkeypatch.setattr("apf.cluster.workers.list_devices", lambda: [gpu] * n_gpus)
    monkeypatch.setattr("apf.cluster.workers.list_own_cores", lambda: list(range(n_cores)))
    found = share_machine()
    assert found == [Share(f"gpu:{k % n_gpus}") for k in range(expected)]


def test_no_scheduler(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    nowhere = connect_cluster("tcp://127.0.0.1:1", tmp_path, patience=0.2)
    with pytest.raises(InputError, match="no scheduler answers"), nowhere:
        pass
