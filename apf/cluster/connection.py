"""A Dask cluster: one of this command's own, or one that runs already."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

from apf.cluster.workers import Share, setup_plugin
from cl import InputError
from psfs.common.files import read_json
from psfs.common.schema import Table, checked
from psfs.output.reconstruction_folder import versions


class _SchedulerFile(Table):
    """What is read of a scheduler's file."""

    address: str


#: Deaths of workers in the midst of a task after which the scheduler gives it up.
ATTEMPTS = 3


def dask_distributed() -> ModuleType:
    """Return the module `distributed`. Raises InputError that says how to get it."""
    try:
        import distributed
    except ImportError:
        raise InputError(
            "many takes on workers need dask.distributed, which is not installed; expected: "
            "pip install psfs-apf[cluster]"
        ) from None
    # They tell of every worker that comes and goes; what matters the outcomes tell.
    for name in ("distributed", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    return distributed


@contextmanager
def embedded_cluster(shares: Sequence[Share]) -> Iterator[Any]:
    """Give the client of a cluster on this machine: a worker process for each share, which is
    started anew when it dies. All end with this process, however that ends."""
    distributed = dask_distributed()
    import dask

    quiet = {
        "distributed.scheduler.allowed-failures": ATTEMPTS - 1,
        "distributed.worker.daemon": False,  # so that a worker may start processes
        "distributed.worker.profile.enabled": False,  # which stops the take 100 times a second
    }
    local = {"host": "127.0.0.1", "dashboard": False, "silence_logs": logging.CRITICAL}
    with TemporaryDirectory(prefix="apf-workers-") as scratch, dask.config.set(quiet):
        common = {**local, "nthreads": 1, "memory_limit": 0, "local_directory": scratch}
        workers = {
            number: {"cls": distributed.Nanny, "options": {**common, "env": share.environment}}
            for number, share in enumerate(shares)
        }
        page = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
        scheduler = {"host": "127.0.0.1", "port": 0, **page}
        cluster = distributed.SpecCluster(
            workers=workers,
            scheduler={"cls": distributed.Scheduler, "options": scheduler},
            silence_logs=logging.CRITICAL,
        )
        with cluster, distributed.Client(cluster) as client:
            client.wait_for_workers(len(shares))
            client.register_plugin(setup_plugin(embedded=True))
            yield client


@contextmanager
def joined_cluster(address: str, shared: Path, patience: float = 10.0) -> Iterator[Any]:
    """Give the client of the running scheduler at `address`, `tcp://HOST:PORT`, or of the file that
    a scheduler wrote (`--scheduler-file`).

    patience: s to wait for it, and for its first worker. Raises InputError where none answers, no
    worker comes, one has another version of this program or does not see the folder `shared`.
    """
    distributed = dask_distributed()
    where: dict[str, str] = {"address": address}
    if Path(address).is_file():
        what = "the file that a `dask scheduler` wrote"
        checked(_SchedulerFile, read_json(Path(address), what), address)
        where = {"scheduler_file": address}
    try:
        client = distributed.Client(**where, timeout=patience)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            f"--scheduler {address}: no scheduler answers ({str(error) or 'timed out'}); expected "
            "tcp://HOST:PORT of a `dask scheduler`, or the file it wrote"
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=patience)
        except TimeoutError:
            raise InputError(
                f"--scheduler {address}: has no worker; expected one: dask worker {address}"
            ) from None
        _check_workers(client, shared)
        client.register_plugin(setup_plugin(embedded=False))
        yield client


def _check_workers(client: Any, shared: Path) -> None:
    found = client.run(_seen_by_worker, str(shared), on_error="return")
    here = versions()["psfs-apf"]
    for address, seen in found.items():
        if isinstance(seen, BaseException):
            raise InputError(f"worker {address}: cannot run psfs-apf {here}: {seen}")
        version, sees = seen
        if version != here:
            raise InputError(f"worker {address}: has psfs-apf {version}; expected {here}, as here")
        if not sees:
            raise InputError(f"worker {address}: sees no folder {shared}; expected a shared one")


def _seen_by_worker(folder: str) -> tuple[str, bool]:
    return versions()["psfs-apf"], Path(folder).is_dir()
