"""What a task has on its worker: a line of progress, a log of its own, and a way to be stopped."""

from __future__ import annotations

import io
import logging
import os
import platform
import sys
import threading
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, TextIO

from apf.cluster.whole_folder import final_names
from cl import UserError

#: Batches whose tasks are to stop in this process.
_stopped: set[str] = set()
#: Seconds between two messages of a task.
_APART = 0.5


class TaskStopped(Exception):
    """The task was told to stop."""


@dataclass(frozen=True)
class Progress:
    """How far a task is: `done` of `total` frames of a stage; total 0 where that is unknown."""

    task: str
    stage: str
    done: int
    total: int
    worker: str


class TaskProgress:
    """What a task reports to. It is the line of a take as `apf.cli.takes.take_report.TakeLine` is:
    called with the name of the stage in work, after every frame of those that go frame by frame.

    worker: host and process. seconds: that each stage took; core_seconds: of the process's CPU
    time. Calls raise KeyboardInterrupt in a task that is to stop.
    """

    def __init__(self, task: str = "", batch: str = "") -> None:
        self.n_frames = 0
        self._task, self._batch = task, batch
        self._stage, self._sent = "", 0.0
        self._done: Counter[str] = Counter()
        self.worker = f"{platform.node()}:{os.getpid()}"
        self.seconds = defaultdict[str, float](float)
        self.core_seconds = defaultdict[str, float](float)
        self._begun = time.monotonic(), time.process_time()

    def __call__(self, stage: str) -> None:
        if self._batch in _stopped:
            raise KeyboardInterrupt
        if stage != self._stage:
            self._enter(stage)
        self._done[stage] += 1
        if time.monotonic() > self._sent + _APART:
            self._send()

    def begin(self, stage: str) -> None:
        """Say that a stage has no frame yet."""
        self._done[stage] = 0
        self._enter(stage)

    def _enter(self, stage: str) -> None:
        """Say that a stage goes on."""
        self.end()
        self._stage = stage
        self._send()

    def end(self) -> None:
        """Count the time since the stage began as its own."""
        now = time.monotonic(), time.process_time()
        if self._stage:
            self.seconds[self._stage] += now[0] - self._begun[0]
            self.core_seconds[self._stage] += now[1] - self._begun[1]
        self._begun = now

    def _send(self) -> None:
        self._sent = time.monotonic()
        if self._batch:
            from distributed import get_worker

            done = self._done[self._stage]
            said = Progress(self._task, self._stage, done, self.n_frames, self.worker)
            get_worker().log_event(self._batch, asdict(said))


def perform(name: str, batch: str, work: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Do a task on a worker. Raises what it raises, and TaskStopped instead of KeyboardInterrupt,
    which would end the worker."""
    try:
        return work(TaskProgress(name, batch), *arguments)
    except KeyboardInterrupt:
        raise TaskStopped(name) from None


def stop(batch: str) -> None:
    """Stop the tasks of a batch in this process after the frame in work."""
    _stopped.add(batch)


class _Log(io.TextIOBase):
    """A file that gets what was said of temporary folders as said of the final ones."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("a", encoding="utf-8", errors="backslashreplace")

    def write(self, text: str) -> int:
        self._file.write(final_names(text))
        self._file.flush()  # it stands there also when the process is killed
        return len(text)

    def close(self) -> None:
        self._file.close()


class _PerThread(io.TextIOBase):
    """A text stream that goes elsewhere in threads that say so."""

    def __init__(self, usual: TextIO) -> None:
        self.usual = usual
        self.own: dict[int, TextIO | _Log] = {}

    def write(self, text: str) -> int:
        return self.own.get(threading.get_ident(), self.usual).write(text)

    def flush(self) -> None:
        self.own.get(threading.get_ident(), self.usual).flush()


@contextmanager
def logged_to(path: Path, title: str) -> Iterator[None]:
    """Append to `path` what this thread prints and logs meanwhile, and the error that ends it, with
    its traceback if it is none that a user can mend."""
    path.parent.mkdir(parents=True, exist_ok=True)
    me = threading.get_ident()
    streams = _streams()
    with closing(_Log(path)) as file:
        now = f"{datetime.now():%Y-%m-%d %H:%M:%S}"
        file.write(f"{now} {title}, on {platform.node()}, process {os.getpid()}\n")
        for stream in streams:
            stream.own[me] = file
        try:
            yield
        except UserError as error:
            file.write(f"error: {error}\n")
            raise
        except BaseException:
            file.write(traceback.format_exc())
            raise
        finally:
            for stream in streams:
                del stream.own[me]


def _streams() -> tuple[_PerThread, _PerThread]:
    """This process's output and error streams, which from now on ask for the thread."""
    if not isinstance(sys.stdout, _PerThread):
        sys.stdout = _PerThread(sys.stdout)
    if not isinstance(sys.stderr, _PerThread):
        sys.stderr = _PerThread(sys.stderr)
        handler = logging.StreamHandler(sys.stderr)
        handler.setFormatter(logging.Formatter("%(name)s: %(message)s"))
        for package in ("cl", "psfs", "apf"):
            logging.getLogger(package).addHandler(handler)
    assert isinstance(sys.stdout, _PerThread) and isinstance(sys.stderr, _PerThread)
    return sys.stdout, sys.stderr
