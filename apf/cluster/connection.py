"""Start a Dask cluster of this command's own, or connect to a running one."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import urlsplit

from apf.cluster.workers import Share, make_setup_plugin
from cl import InputError
from psfs.common.files import read_json
from psfs.common.schema import Table, parse_values
from psfs.common.scratch import temporary_folder
from psfs.common.system import defer_interrupts
from psfs.common.versions import versions


class _SchedulerFile(Table):
    """The entries of a scheduler's file that are read."""

    address: str


#: Number of workers that may die during a task before the scheduler gives it up.
ATTEMPTS = 3
#: Networks of Dask whose servers are not asked for their greeting.
_OTHER_NETWORKS = ("tls", "ucx", "ucxx", "ws", "wss")
#: Bytes; of a scheduler about 200.
_LONGEST_GREETING = 2**16


def import_distributed() -> ModuleType:
    """Import `distributed`. Raises InputError that says how to install it."""
    try:
        import distributed
    except ImportError:
        raise InputError(
            "many takes on workers need dask.distributed, which is not installed; expected: "
            "pip install psfs-apf[cluster]"
        ) from None
    # Dask logs every worker that joins or leaves; the tasks' outcomes report what matters.
    # Loggers of its modules have levels of their own.
    for name in ("asyncio", *logging.root.manager.loggerDict):
        if name.split(".")[0] in ("distributed", "asyncio", "tornado"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
    return distributed


@contextmanager
def start_cluster(shares: Sequence[Share]) -> Iterator[object]:
    """Start a cluster on this machine with a worker process per share, and yield its client.

    Workers that die are restarted. All end with this process, however it ends.
    """
    distributed = import_distributed()
    import dask

    quiet = {
        "distributed.scheduler.allowed-failures": ATTEMPTS - 1,
        "distributed.worker.daemon": False,  # so that a worker may start processes
        # it would interrupt the take 100 times a second
        "distributed.worker.profile.enabled": False,
    }
    local = {"host": "127.0.0.1", "dashboard": False, "silence_logs": logging.CRITICAL}
    with (
        temporary_folder() as scratch,
        dask.config.set({**quiet, "temporary-directory": str(scratch)}),
    ):
        common = {**local, "nthreads": 1, "memory_limit": 0, "local_directory": str(scratch)}
        workers = {
            number: {"cls": distributed.Nanny, "options": {**common, "env": share.environment}}
            for number, share in enumerate(shares)
        }
        page = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
        scheduler = {"host": "127.0.0.1", "port": 0, **page}
        with ExitStack() as stack:
            with defer_interrupts():  # a cluster that is half started cannot be closed
                make = partial(
                    distributed.SpecCluster,
                    workers=workers,
                    scheduler={"cls": distributed.Scheduler, "options": scheduler},
                    silence_logs=logging.CRITICAL,
                )
                cluster = stack.enter_context(_start_again_if_one_dies(make))
            client = stack.enter_context(distributed.Client(cluster))
            client.wait_for_workers(len(shares))
            client.register_plugin(make_setup_plugin(embedded=True))
            yield client


def _start_again_if_one_dies(make: Callable[[], Any]) -> Any:
    """Return the cluster that `make` starts. Raises InputError if a worker dies at each attempt."""
    for _ in range(ATTEMPTS):
        try:
            return make()
        except RuntimeError as error:  # the cluster has closed itself
            reason = error.__cause__ or error
    raise InputError(
        f"a worker process ended while it started, {ATTEMPTS} times ({reason}); expected enough "
        "memory for fewer --workers, or a Python that starts"
    )


def find_scheduler(address: str, patience: float = 10.0) -> str:
    """Return the address of a running scheduler, which may be stated by the file that it wrote.
    Raises InputError if none answers within `patience`, s."""
    where = _read_scheduler_file(Path(address)) if Path(address).exists() else address
    try:
        _check_answer(where, patience)
    except (OSError, ValueError, TimeoutError) as error:
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
def connect_cluster(address: str, shared: Path, patience: float = 10.0) -> Iterator[object]:
    """Connect to a running scheduler and yield the client.

    address: `tcp://HOST:PORT`, or the file that a scheduler wrote (`--scheduler-file`). patience:
    time to wait for the scheduler and for its first worker, s. Raises InputError if none answers,
    no worker joins, or a worker has another version of this program or cannot see the folder
    `shared`.
    """
    distributed = import_distributed()
    where = find_scheduler(address, patience)
    try:
        client = distributed.Client(where, timeout=patience)
    except (OSError, ValueError, TimeoutError) as error:
        raise _no_answer_error(address, error) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=patience)
        except TimeoutError:
            raise InputError(
                f"--scheduler {address}: has no worker; expected one: dask worker {address}"
            ) from None
        _check_workers(client, shared)
        client.register_plugin(make_setup_plugin(embedded=False))
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
    found = client.run(_inspect_worker, str(shared), on_error="return")
    here = versions()["psfs-apf"]
    for address, seen in found.items():
        if isinstance(seen, BaseException):
            raise InputError(f"worker {address}: cannot run psfs-apf {here}: {seen}")
        version, sees = seen
        if version != here:
            raise InputError(f"worker {address}: has psfs-apf {version}; expected {here}, as here")
        if not sees:
            raise InputError(f"worker {address}: sees no folder {shared}; expected a shared one")


def _inspect_worker(folder: str) -> tuple[str, bool]:
    return versions()["psfs-apf"], Path(folder).is_dir()
