"""Track several takes in one process, each in a thread with its own queue on the one device.

The takes share the process, the device's context and memory, and the programs: each program is
compiled once for all takes of the same size. While the host decodes video or fits the body's shape
for one take, the device works for another. The takes share no kernel launch, because bodies, grids
and numbers of frames differ from take to take. (The seeds of one take do share launches, see
`track_frames`.) So the tracks of a take are bit-equal to those of a run of that take alone.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Generator
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from typing import TypeVar

from apf.tracking.config import ON_CPU, ON_GPU
from cl import Device, NumpyDevice, UserError

log = logging.getLogger(__name__)

R = TypeVar("R")


def default_concurrency(device: Device | NumpyDevice) -> int:
    """Return the number of takes to track at the same time, see `ON_GPU`."""
    return ON_GPU if isinstance(device, Device) and device.is_gpu else ON_CPU


def run_at_once(
    device: Device | NumpyDevice,
    work: Callable[[Device | NumpyDevice, int, Callable[[], None]], R],
    n_takes: int,
    n_at_once: int | None = None,
) -> Generator[tuple[int, R | UserError], None, None]:
    """Call `work(device, number, check)` for every take, `n_at_once` at a time, each in a thread
    with its own queue on the device. Yield each take's number with the result, or with the
    UserError that was raised, as soon as it is done.

    After a KeyboardInterrupt, here or in a thread, no further take is started, `check()` raises it
    in every thread, and this function raises it when the last thread has ended. Any other exception
    also ends all work and is raised. Closing the iterator ends all work, too.
    """
    interrupted = threading.Event()

    def check() -> None:
        if interrupted.is_set():
            raise KeyboardInterrupt

    def one(number: int) -> tuple[int, R | UserError]:
        check()
        try:
            own = device.sibling() if isinstance(device, Device) else device
            return number, work(own, number, check)
        except UserError as error:
            return number, error
        except BaseException:
            interrupted.set()  # before this thread begins another
            raise

    workers = n_at_once or default_concurrency(device)
    with ThreadPoolExecutor(workers, thread_name_prefix="apf-take") as pool:
        try:
            waiting = {pool.submit(one, number) for number in range(n_takes)}
            while waiting:
                try:
                    # Not for long: an interrupt just before it waits does not wake it.
                    done, waiting = wait(waiting, 0.5, FIRST_COMPLETED)
                except KeyboardInterrupt:
                    interrupted.set()
                    log.warning("interrupted: takes end after the frame in work")
                    continue
                for future in done:
                    if not isinstance(future.exception(), KeyboardInterrupt):
                        yield future.result()
            check()
        finally:
            interrupted.set()
