"""Jobs of a suite, one after the other or spread over processes."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from multiprocessing.synchronize import Event

from accuracy.suite import Job, Outcome, done
from cl import Device, DeviceError, UserError, select_device

#: What a process keeps from job to job: what it computes on, and whether to stop.
_own: dict[str, object] = {}


def do_jobs(
    jobs: Iterable[Job],
    device: Device,
    name: str,
    processes: int,
    keep: Callable[[Job, Outcome | UserError], object],
    seconds: float | None = None,
) -> None:
    """Do the jobs and call `keep` with what each gave, or with the error of one that cannot be
    done. Begin none after so many seconds. name: of the device, for the processes to make their
    own. Raises DeviceError; after a KeyboardInterrupt all that is done is kept before it is raised.
    """
    end = time.monotonic() + (seconds or math.inf)
    begun = (job for job in jobs if time.monotonic() < end)
    if processes > 1:
        _spread(begun, name, processes, keep)
        return
    for job in begun:
        keep(job, _attempted(device, job, lambda: None))


def _spread(
    jobs: Iterable[Job],
    name: str,
    processes: int,
    keep: Callable[[Job, Outcome | UserError], object],
) -> None:
    context = get_context("spawn")  # a device does not survive a fork
    stop = context.Event()
    ahead = iter(jobs)
    waiting: dict[Future[Outcome | UserError], Job] = {}
    with ProcessPoolExecutor(processes, context, _begin, (name, stop)) as pool:
        try:
            while True:
                while len(waiting) < processes and (job := next(ahead, None)) is not None:
                    waiting[pool.submit(_work, job)] = job
                if not waiting:
                    return
                for future in wait(waiting, 0.5, FIRST_COMPLETED).done:
                    outcome = future.result()
                    keep(waiting.pop(future), outcome)
        except BrokenProcessPool:
            raise DeviceError(
                f"a process ended; is there memory for --processes {processes}?"
            ) from None
        except BaseException:
            stop.set()  # the others end after the frame in work
            pool.shutdown(cancel_futures=True)
            for future, job in waiting.items():
                if not future.cancelled() and future.exception() is None:
                    keep(job, future.result())
            raise


def _begin(name: str, stop: Event) -> None:
    """Begin a process. Interrupts are the parent's, which then sets `stop`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _own.update(name=name, stop=stop)


def _work(job: Job) -> Outcome | UserError:
    """Do a job in a process, which makes its device for the first one."""
    if "device" not in _own:
        _own["device"] = select_device(str(_own["name"]))
    device, stop = _own["device"], _own["stop"]
    assert isinstance(device, Device) and isinstance(stop, Event)

    def check() -> None:
        if stop.is_set():
            raise KeyboardInterrupt

    return _attempted(device, job, check)


def _attempted(device: Device, job: Job, check: Callable[[], object]) -> Outcome | UserError:
    try:
        return done(device, job, check)
    except DeviceError:
        raise
    except UserError as error:
        return error
