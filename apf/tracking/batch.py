"""Many takes in one process, some at a time, each in a thread with a queue of its own on the one
device.

They share the process, the device's context and memory, and the programs, each of which is
compiled once for all takes of the same size; while one take's host decodes video or fits its
person's shape, the device works for another. They share no kernel launch: bodies, grids and numbers
of frames differ from take to take. (The seeds of one take do share them, see `track_frames`.) So a
take's tracks are, bit by bit, those that it has alone.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Generator
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from typing import TypeVar

from apf.tracking.config import BatchConfig
from cl import Device, NumpyDevice, UserError

log = logging.getLogger(__name__)

R = TypeVar("R")


def default_at_once(device: Device | NumpyDevice) -> int:
    """Return how many takes at a time pay, see `BatchConfig`."""
    config = BatchConfig()
    return config.on_gpu if isinstance(device, Device) and device.is_gpu else config.on_cpu


def at_once(
    device: Device | NumpyDevice,
    work: Callable[[Device | NumpyDevice, int, Callable[[], None]], R],
    n_takes: int,
    n_at_once: int | None = None,
) -> Generator[tuple[int, R | UserError], None, None]:
    """Yield every take's number with what `work(device, number, check)` returned or the UserError
    that it raised, as they are done; `n_at_once` at a time, each in a thread with a queue of its
    own on the device.

    After a KeyboardInterrupt, here or in a thread, no take is begun, `check()` raises it in every
    thread, and so does this function once the last one has ended. Any other exception ends all
    work likewise and is raised. So does closing the iterator.
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

    workers = n_at_once or default_at_once(device)
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
