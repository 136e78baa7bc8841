"""Jobs of a suite, run in sequence or on workers, as `apf batch` runs takes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

from accuracy.suite import Job, Outcome, done
from apf.cluster.connection import DaskPool, connect_cluster
from apf.cluster.processes import Pool, Processes, Task
from apf.cluster.task_side import TaskProgress
from apf.cluster.workers import select_worker_device, share_machine
from cl import Device, DeviceError, UserError


@contextmanager
def start_workers(out: Path, device: str, processes: int, scheduler: str | None) -> Iterator[Pool]:
    """Yield the workers of a running Dask cluster, which need scripts/ in their PYTHONPATH, or
    `processes` new ones on the named device."""
    if scheduler is not None:
        out.mkdir(parents=True, exist_ok=True)
        with connect_cluster(scheduler, out.resolve()) as client:
            yield DaskPool(client)
    else:
        with Processes(share_machine(device, processes)) as pool:
            yield pool


def do_jobs(
    jobs: Iterable[Job],
    device: Device,
    pool: Pool | None,
    keep: Callable[[Job, Outcome | UserError], object],
    seconds: float | None = None,
) -> None:
    """Do the jobs on `device`, or on the workers of `pool` if given.

    Call `keep` with the result of each job, or with its error. Start no job after `seconds`. Raises
    DeviceError. After a KeyboardInterrupt all finished jobs are kept.
    """
    end = time.monotonic() + (seconds or math.inf)
    begun = (job for job in jobs if time.monotonic() < end)
    if pool is None:
        for job in begun:
            keep(job, _attempt(device, job, lambda: None))
        return
    works = ((job, partial(pool.run, Task(str(job), do_job, (job,)))) for job in begun)
    with closing(pool.outcomes(works)) as outcomes:
        for job, outcome in outcomes:
            if isinstance(outcome, BaseException) and not isinstance(outcome, UserError):
                raise outcome
            if isinstance(outcome, DeviceError):
                raise outcome
            keep(job, outcome)


def do_job(progress: TaskProgress, job: Job) -> Outcome | UserError:
    """Do a job on a worker."""
    device = select_worker_device("auto")
    assert isinstance(device, Device)
    return _attempt(device, job, lambda: progress("tracking"))


def _attempt(device: Device, job: Job, check: Callable[[], object]) -> Outcome | UserError:
    try:
        return done(device, job, check)
    except DeviceError:
        raise
    except UserError as error:
        return error
