"""The environment of a task on its worker: progress messages, a log file, and a stop signal."""

from __future__ import annotations

import io
import logging
import os
import platform
import sys
import threading
import time
import traceback
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, TextIO

from apf.cluster.whole_folder import replace_temporary_names
from apf.tracking.progress import StageProgress
from cl import UserError

#: Batches whose tasks must stop in this process.
_stopped: set[str] = set()
#: Least time between two messages of a task, s.
_MESSAGE_INTERVAL = 0.5


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

    It replaces the line of a take, `apf.cli.take_report.TakeLine`: called with the name of
    the current stage, after every frame of stages that work by frames. worker: host and process.
    seconds: time of each stage. core_seconds: CPU time of each stage. Calls raise KeyboardInterrupt
    in a task that must stop.
    """

    def __init__(self, task: str = "", batch: str = "") -> None:
        super().__init__()
        self._task, self._batch, self._sent = task, batch, 0.0
        self.worker = f"{platform.node()}:{os.getpid()}"
        self.seconds = defaultdict[str, float](float)
        self.core_seconds = defaultdict[str, float](float)
        self._begun = time.monotonic(), time.process_time()

    @property
    def done(self) -> int:
        """Number of frames that the current stage has done."""
        return self._done[self._stage]

    def __call__(self, stage: str) -> None:
        if self._batch in _stopped:
            raise KeyboardInterrupt
        if stage != self._stage:
            self._enter(stage)
        self._done[stage] += 1
        if time.monotonic() > self._sent + _MESSAGE_INTERVAL:
            self._send()

    def _enter(self, stage: str) -> None:
        """Switch to a stage."""
        self.end()
        self._stage = stage
        self._send()

    def end(self) -> None:
        """Add the time since the stage began to its total."""
        now = time.monotonic(), time.process_time()
        if self._stage:
            self.seconds[self._stage] += now[0] - self._begun[0]
            self.core_seconds[self._stage] += now[1] - self._begun[1]
        self._begun = now

    def warn(self, text: str) -> None:
        print(f"warning: {text}", file=sys.stderr)

    def note(self, text: str) -> None:
        print(f"note: {text}")

    def tell(self, text: str) -> None:
        print(text, file=sys.stderr)

    def _send(self) -> None:
        self._sent = time.monotonic()
        if self._batch:
            from distributed import get_worker

            message = Progress(
                self._task, self._stage, self.done, self.n_frames, self.worker, self._whose
            )
            get_worker().log_event(self._batch, asdict(message))


def run_task(
    name: str, batch: str, work: Callable[..., object], arguments: tuple[object, ...]
) -> Any:
    """Run a task on a worker.

    Raises what it raises, but TaskStopped instead of KeyboardInterrupt, which would end the worker.
    """
    try:
        return work(TaskProgress(name, batch), *arguments)
    except KeyboardInterrupt:
        raise TaskStopped(name) from None


def stop(batch: str) -> None:
    """Stop the tasks of a batch in this process after the current frame."""
    _stopped.add(batch)


class _Log(io.TextIOBase):
    """A log file in which names of temporary folders are replaced by the final ones."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("a", encoding="utf-8", errors="backslashreplace")

    def write(self, text: str) -> int:
        self._file.write(replace_temporary_names(text))
        self._file.flush()  # so that nothing is lost if the process is killed
        return len(text)

    def close(self) -> None:
        self._file.close()


class _PerThread(io.TextIOBase):
    """A text stream that threads can redirect for themselves."""

    def __init__(self, usual: TextIO) -> None:
        self.usual = usual
        self.own: dict[int, TextIO | _Log] = {}

    def write(self, text: str) -> int:
        return self.own.get(threading.get_ident(), self.usual).write(text)

    def flush(self) -> None:
        self.own.get(threading.get_ident(), self.usual).flush()


@contextmanager
def log_to(path: Path, title: str) -> Iterator[None]:
    """Append to `path` what this thread prints and logs, and the error that ends it.

    An error that is not the user's gets its traceback.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    me = threading.get_ident()
    streams = _redirectable_streams()
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


def _redirectable_streams() -> tuple[_PerThread, _PerThread]:
    """Return this process's output and error streams, made redirectable per thread."""
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
