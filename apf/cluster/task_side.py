"""The environment of a task on its worker: progress messages, a log file, and a stop signal."""

from __future__ import annotations

import logging
import os
import platform
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from apf.tracking.progress import StageProgress
from cl import UserError

#: Batches whose tasks must stop in this process.
_stopped: set[str] = set()
#: Least time between two messages of a task, and between two looks at who works, s.
PULSE = 0.5


class TaskStopped(Exception):
    """The task was stopped."""


@dataclass(frozen=True)
class Progress:
    """The progress of a task: `done` of `total` frames of a stage; total 0 if unknown. whose: words
    before the stage, on which of several people is tracked."""

    task: str
    stage: str
    done: int
    total: int
    worker: str
    whose: str = ""


class TaskProgress(StageProgress):
    """Receives and sends a task's progress.

    It replaces the line of a take, `apf.tracking.progress.ProgressLine`: called with the name of
    the current stage, after every frame of stages that work by frames. send: receives messages.
    check: called first, raises KeyboardInterrupt in a task that must stop. worker: host and
    process.
    """

    def __init__(
        self,
        task: str = "",
        send: Callable[[Progress], object] = lambda message: None,
        check: Callable[[], object] = lambda: None,
    ) -> None:
        super().__init__()
        self._task, self._send_message, self._check, self._sent = task, send, check, 0.0
        self.worker = f"{platform.node()}:{os.getpid()}"

    def __call__(self, stage: str) -> None:
        self._check()
        if stage != self._stage:
            self._enter(stage)
        self._done[stage] += 1
        if time.monotonic() > self._sent + PULSE:
            self._send()

    def _enter(self, stage: str) -> None:
        """Switch to a stage."""
        self._stage = stage
        self._send()

    def warn(self, text: str) -> None:
        print(f"warning: {text}", file=sys.stderr)

    def note(self, text: str) -> None:
        print(f"note: {text}")

    def tell(self, text: str) -> None:
        print(text, file=sys.stderr)

    def _send(self) -> None:
        self._sent = time.monotonic()
        done, whose = self._done[self._stage], self._whose
        message = Progress(self._task, self._stage, done, self.n_frames, self.worker, whose)
        self._send_message(message)


def run_task(
    name: str, batch: str, work: Callable[..., object], arguments: tuple[object, ...]
) -> Any:
    """Run a task on a worker of Dask.

    Raises what it raises, but TaskStopped instead of KeyboardInterrupt, which would end the worker.
    """
    from distributed import get_worker

    def check() -> None:
        if batch in _stopped:
            raise KeyboardInterrupt

    def send(message: Progress) -> None:
        get_worker().log_event(batch, asdict(message))

    try:
        return work(TaskProgress(name, send, check), *arguments)
    except KeyboardInterrupt:
        raise TaskStopped(name) from None


def stop(batch: str) -> None:
    """Stop the tasks of a batch in this process after the current frame."""
    _stopped.add(batch)


@contextmanager
def log_to(path: Path, title: str) -> Iterator[None]:
    """Append to `path` what this process prints and logs, and the error that ends it.

    An error that is not the user's gets its traceback.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with (
        path.open("a", encoding="utf-8", errors="backslashreplace", buffering=1) as file,
        redirect_stdout(file),
        redirect_stderr(file),
    ):
        print(f"{datetime.now():%Y-%m-%d %H:%M:%S} {title}, on {platform.node()}, "
              f"process {os.getpid()}")  # fmt: skip
        handler = logging.StreamHandler(file)
        handler.setFormatter(logging.Formatter("%(name)s: %(message)s"))
        loggers = [logging.getLogger(package) for package in ("cl", "psfs", "apf")]
        for logger in loggers:
            logger.addHandler(handler)
        try:
            yield
        except UserError as error:
            print(f"error: {error}")
            raise
        except BaseException:
            print(traceback.format_exc())
            raise
        finally:
            for logger in loggers:
                logger.removeHandler(handler)
