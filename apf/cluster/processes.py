"""Workers of this machine: a process each, which only this command can speak to, by a pipe."""

from __future__ import annotations

import os
import pickle
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing import connection, get_context, parent_process
from multiprocessing.connection import Connection
from typing import NoReturn

from apf.cluster.pool import Outcome, Pool, Task
from apf.cluster.task_side import Progress, TaskProgress, TaskStopped
from apf.cluster.workers import Share, set_up_worker
from cl import InputError
from psfs.common.system import changed_environment, defer_interrupts, handle_signals

#: Time in which a stopped take writes what it has, s.
_TO_WRITE = 60.0


class _Worker:
    """A worker process with its share of the machine."""

    def __init__(self, share: Share) -> None:
        self.share = share
        self.task: Task | None = None
        self.start()

    def start(self) -> None:
        """Start the process, which the terminal's interrupts do not reach."""
        context = get_context("spawn")  # no OpenCL survives a fork
        self.connection, other = context.Pipe()
        with defer_interrupts(["SIGINT"]), changed_environment(self.share.environment):
            self.process = context.Process(target=_serve, args=(other,), name="take worker")
            self.process.start()
        other.close()

    def end(self) -> None:
        """End the process after its current frame, or by force."""
        self.process.terminate()
        try:
            self.process.join(_TO_WRITE)
        finally:
            self.process.kill()
            self.process.join()
            self.connection.close()


class Processes(Pool):
    """Worker processes, one for each of the `shares` of this machine; one that dies is started
    again. Ends them all at the end of the `with` block."""

    def __init__(
        self, shares: Sequence[Share], on_progress: Callable[[Progress], object] | None = None
    ) -> None:
        super().__init__()
        self._on_progress = on_progress
        self._workers = [_Worker(share) for share in shares]

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:  # together, before any is waited for
            worker.process.terminate()
        for worker in self._workers:
            worker.end()

    def count_workers(self) -> int:
        return len(self._workers)

    def count_running(self) -> int:
        return sum(worker.task is not None for worker in self._workers)

    def submit(self, task: Task, attempt: int) -> None:
        worker = next(worker for worker in self._workers if worker.task is None)
        worker.task = task
        with suppress(OSError):  # it has died: `poll` notices
            worker.connection.send(task)

    def poll(self, seconds: float) -> list[Outcome]:
        done = list[Outcome]()
        busy = {worker.connection: worker for worker in self._workers if worker.task is not None}
        for ready in connection.wait(list(busy), seconds):
            worker = busy[ready]  # type: ignore[index]
            assert worker.task is not None
            try:
                message = worker.connection.recv()
            except (EOFError, OSError):
                message = InputError(f"its worker, process {worker.process.pid}, died")
                worker.end()
                worker.start()
            if isinstance(message, Progress):
                if self._on_progress is not None:
                    self._on_progress(message)
                continue
            done.append((worker.task, message))
            worker.task = None
        return done

    def stop(self) -> None:
        running = [worker for worker in self._workers if worker.task is not None]
        for worker in running:
            worker.process.terminate()
        for worker in running:
            worker.end()
            worker.task = None
            worker.start()


def _serve(tasks: Connection) -> None:
    """Do the tasks that come, until the other process ends or SIGTERM comes."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    lock = threading.Lock()

    def send(message: object) -> None:
        with lock:
            tasks.send(message)

    def interrupt(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    with suppress(KeyboardInterrupt, EOFError, OSError), handle_signals(interrupt, ["SIGTERM"]):
        set_up_worker()
        while True:
            task: Task = tasks.recv()
            try:
                outcome = task.work(TaskProgress(task.name, send), *task.arguments)
            except KeyboardInterrupt:
                outcome = TaskStopped(task.name)
            except Exception as error:
                outcome = _picklable(error)
            send(outcome)


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    connection.wait([parent.sentinel])
    os._exit(1)


def _picklable(error: Exception) -> Exception:
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error
