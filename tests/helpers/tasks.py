"""What workers do in tests. It imports little, since every worker that is started imports it."""

import os
import threading
import time
from pathlib import Path

from apf.cluster.task_side import TaskProgress
from cl import InputError
from psfs.common.system import list_own_cores


def double(progress: TaskProgress, number: int) -> tuple[int, int, str]:
    progress.n_frames = 1
    progress("doubling")
    return 2 * number, len(list_own_cores()), os.environ["POCL_MAX_PTHREAD_COUNT"]


def die_until(progress: TaskProgress, tries: str, attempts: int) -> int:
    """Kill the worker so many times."""
    attempt = counted(tries)
    if attempt <= attempts:
        os.kill(os.getpid(), 9)
    return attempt


def raise_until(progress: TaskProgress, tries: str, attempts: int) -> int:
    attempt = counted(tries)
    if attempt <= attempts:
        raise InputError(f"attempt {attempt}")
    return attempt


def counted(path: str) -> int:
    with Path(path).open("a") as file:
        file.write("x")
    return Path(path).stat().st_size


def interrupted(progress: TaskProgress) -> None:
    raise KeyboardInterrupt


def hang(progress: TaskProgress) -> None:
    threading.Event().wait()


def wait_for_stop(progress: TaskProgress, path: str) -> None:
    """Work until the task is stopped, then write a file."""
    try:
        while True:
            progress("waiting")
            time.sleep(0.05)
    except KeyboardInterrupt:
        Path(path).write_text("frames so far")
        raise
