"""Connect to a running Dask cluster, and run tasks on its workers."""

from __future__ import annotations

import logging
import socket
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import urlsplit

from apf.cluster.processes import ATTEMPTS, Pool, Task
from apf.cluster.task_side import Progress, run_task, stop
from apf.cluster.workers import set_up_worker
from cl import InputError
from cl.errors import pip_command
from psfs.common.files import read_json
from psfs.common.schema import Table, parse_values
from psfs.common.system import versions


class _SchedulerFile(Table):
    """The entries of a scheduler's file that are read."""

    address: str


#: Networks of Dask whose servers are not asked for their greeting.
_OTHER_NETWORKS = ("tls", "ucx", "ucxx", "ws", "wss")
#: Bytes; of a scheduler about 200.
_LONGEST_GREETING = 2**16
_GONE = "the scheduler has gone; what is finished is kept: give the command again"
#: Time, s, between two looks for workers, and after which a cluster without any has lost them.
_LOOK, _PATIENCE = 5.0, 60.0


def import_distributed() -> ModuleType:
    """Import `distributed`. Raises InputError that says how to install it."""
    try:
        import distributed
    except ImportError:
        raise InputError(
            "--scheduler needs dask.distributed, which is not installed; expected: "
            f"{pip_command('cluster')}"
        ) from None
    # Dask logs every worker that joins or leaves; the tasks' outcomes report what matters.
    # Loggers of its modules have levels of their own.
    for name in ("asyncio", *logging.root.manager.loggerDict):
        if name.split(".")[0] in ("distributed", "asyncio", "tornado"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
    return distributed


def find_scheduler(address: str, patience: float = 10.0) -> str:
    """Return the address of a running scheduler, which may be stated by the file that it wrote.
    Raises InputError if none answers within `patience`, s."""
    where = _read_scheduler_file(Path(address)) if Path(address).exists() else address
    try:
        _check_answer(where, patience)
    except (OSError, ValueError) as error:
        raise _no_answer_error(address, error) from None
    return where


def _read_scheduler_file(path: Path) -> str:
    what = "the file that a `dask scheduler` wrote"
    return parse_values(_SchedulerFile, read_json(path, what), path).address


def _no_answer_error(address: str, error: Exception) -> InputError:
    return InputError(
        f"--scheduler {address}: no scheduler answers ({str(error) or 'timed out'}); expected "
        "tcp://HOST:PORT of a `dask scheduler`, or the file it wrote"
    )


@contextmanager
def connect_cluster(address: str, shared: Path, patience: float = 10.0) -> Iterator[Any]:
    """Connect to a running scheduler and yield its client, see `DaskPool`.

    address: `tcp://HOST:PORT`, or the file that a scheduler wrote (`--scheduler-file`). patience:
    time to wait for the scheduler and for its first worker, s. Raises InputError if none answers,
    no worker joins, or a worker has another version of this program or cannot see the folder
    `shared`.
    """
    distributed = import_distributed()
    where = find_scheduler(address, patience)
    try:
        client = distributed.Client(where, timeout=patience)
    except (OSError, ValueError) as error:
        raise _no_answer_error(address, error) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=patience)
        except TimeoutError:
            raise InputError(
                f"--scheduler {address}: has no worker; expected one: dask worker {address}"
            ) from None
        _check_workers(client, shared)
        client.register_plugin(_make_setup_plugin())
        yield client


def _check_answer(address: str, patience: float) -> None:
    """Raise OSError, TimeoutError or ValueError unless a Dask scheduler listens at `address`.

    It sends its greeting, after the greeting's length, before it is asked anything. Dask's own
    client takes the first bytes of any other server for a length, and waits or allocates.
    """
    parts = urlsplit(address if "//" in address else f"tcp://{address}")
    if parts.scheme != "tcp":  # encrypted, or of another network
        if parts.scheme not in _OTHER_NETWORKS:
            raise ValueError(f"{parts.scheme}:// is not a scheduler's")
        return
    if not parts.hostname or not parts.port:
        raise ValueError("it names no host and port")
    with socket.create_connection((parts.hostname, parts.port), patience) as connection:
        connection.settimeout(patience)
        greeting = connection.recv(8, socket.MSG_WAITALL)
    length = int.from_bytes(greeting, "little")
    if len(greeting) < 8 or not 0 < length < _LONGEST_GREETING:
        raise ValueError("another kind of server answers")


def _check_workers(client: Any, shared: Path) -> None:
    answers = client.run(_inspect_worker, str(shared), on_error="return")
    here = versions()["psfs-apf"]
    for address, seen in answers.items():
        if isinstance(seen, BaseException):
            raise InputError(f"worker {address}: cannot run psfs-apf {here}: {seen}")
        version, sees = seen
        if version != here:
            raise InputError(f"worker {address}: has psfs-apf {version}; expected {here}, as here")
        if not sees:
            raise InputError(f"worker {address}: sees no folder {shared}; expected a shared one")


def _inspect_worker(folder: str) -> tuple[str, bool]:
    return versions()["psfs-apf"], Path(folder).is_dir()


def _make_setup_plugin() -> Any:
    """Return the Dask plugin that sets up every worker, also those that join later."""
    from distributed import WorkerPlugin

    class TakeWorker(WorkerPlugin):
        name = "apf-take-worker"

        def setup(self, worker: object) -> None:
            set_up_worker()

    return TakeWorker()


class DaskPool(Pool):
    """The workers of a Dask cluster, by its `client`, as many as they have threads. Dask repeats a
    task whose worker dies, as often as the cluster's own settings say."""

    def __init__(self, client: Any, on_progress: Callable[[Progress], object] | None = None):
        self._client, self._running = client, set[Any]()
        self.batch = uuid.uuid4().hex
        if on_progress is not None:
            client.subscribe_topic(self.batch, lambda event: on_progress(Progress(**event[1])))

    def count_workers(self) -> int:
        return sum(self._client.nthreads().values())

    def run(self, task: Task) -> Any:
        distributed = import_distributed()
        future = self._client.submit(
            run_task, task.name, self.batch, task.work, task.arguments,
            key=f"{task.name}-{uuid.uuid4().hex}", pure=False, retries=ATTEMPTS - 1,
        )  # fmt: skip
        self._running.add(future)
        try:
            self._wait(future)
            return future.result()
        except distributed.KilledWorker as error:
            worker = getattr(error.last_worker, "address", error.last_worker)
            raise InputError(f"its workers died, at last {worker}") from None
        except (distributed.CancelledError, distributed.comm.CommClosedError):
            raise InputError(_GONE) from None
        finally:
            self._running.discard(future)

    def _wait(self, future: Any) -> None:
        """Wait for the end of a task. Raises InputError if the cluster has no worker for long."""
        distributed, left = import_distributed(), _PATIENCE
        while left > 0:
            try:
                distributed.wait(future, timeout=_LOOK)
                return
            except distributed.TimeoutError:
                left = _PATIENCE if self.count_workers() else left - _LOOK
        raise InputError(
            f"the scheduler has had no worker for {_PATIENCE:g} s; what is finished is kept: start "
            "workers, and give the command again"
        )

    def stop(self) -> None:
        if self._running and self._client.status == "running":
            with suppress(OSError, TimeoutError):  # the scheduler may be gone
                self._client.run(stop, self.batch, on_error="ignore")
                self._client.cancel(list(self._running), force=True)
