"""Pools of workers, which run the tasks that jobs consist of, and the pool of this machine: a
process for each worker, which only this command can speak to, by a pipe."""

from __future__ import annotations

import os
import pickle
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from multiprocessing import connection, get_context, parent_process
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, NoReturn, TypeVar

from apf.cluster.task_side import PULSE, Progress, TaskProgress, TaskStopped
from apf.cluster.workers import MOST_WORKERS, Share, set_up_worker
from cl import InputError
from psfs.common.system import (
    PATIENCE,
    changed_environment,
    defer_interrupts,
    handle_signals,
    ignore_signals,
)

#: Number of times that a task is tried.
ATTEMPTS = 3

T = TypeVar("T")


@dataclass(frozen=True)
class Task:
    """A unit of work for one worker.

    name: unique. work: a module's function, called as `work(progress, *arguments)`, see
    `TaskProgress`. arguments: plain values.
    """

    name: str
    work: Callable[..., object]
    arguments: tuple[object, ...] = ()


class Pool(ABC):
    """Runs tasks on workers, as many at a time as there are workers.

    A task that fails, or whose worker dies, is repeated; the exception of the third attempt counts,
    and does not stop the others. Subclasses say where the workers are.
    """

    @abstractmethod
    def count_workers(self) -> int:
        """Return how many tasks the workers can do at a time."""

    @abstractmethod
    def run(self, task: Task) -> Any:
        """Wait for a free worker, have it do a task, and return the result. Called in threads.
        Raises the task's exception, and InputError if its workers die or all are lost."""

    @abstractmethod
    def stop(self) -> None:
        """Stop the running tasks after their current frames; no others can be run then."""

    def run_all(self, tasks: Sequence[Task]) -> list[Any]:
        """Run tasks at the same time, and return their results in order."""
        with ThreadPoolExecutor(len(tasks)) as threads:
            return list(threads.map(self.run, tasks))

    def outcomes(
        self, jobs: Iterable[tuple[T, Callable[[], Any]]]
    ) -> Generator[tuple[T, Any], None, None]:
        """Call jobs, which run tasks, in threads; yield each one's name with its result, or with
        its exception, as they finish.

        A job is requested when a worker may be free. Closing the generator, or an interrupt, stops
        the running tasks.
        """
        jobs, running = iter(jobs), dict[Future[Any], T]()
        with ThreadPoolExecutor(MOST_WORKERS) as threads:
            try:
                while True:
                    n_free = max(1, self.count_workers()) - len(running)
                    for name, job in islice(jobs, max(0, n_free)):
                        running[threads.submit(job)] = name
                    if not running:
                        return
                    for future in wait(running, PULSE, FIRST_COMPLETED).done:
                        yield running.pop(future), future.exception() or future.result()
            finally:
                if running:
                    self.stop()


#: Time without a word from a take, s, after which its worker hangs: stages take minutes.
_SILENCE = 1800.0


class _Worker:
    """A worker process with its share of the machine."""

    #: Held while a process starts with its environment, which is that of all threads.
    _starting = threading.Lock()

    def __init__(self, share: Share) -> None:
        self.share = share
        self.start()

    def start(self) -> None:
        """Start the process, which the terminal's interrupts do not reach."""
        context = get_context("spawn")  # no OpenCL survives a fork
        self.connection, other = context.Pipe()
        with (
            self._starting,
            defer_interrupts(["SIGINT"]),
            changed_environment(self.share.environment),
        ):
            self.process = context.Process(target=_serve, args=(other,), name="take worker")
            self.process.start()
        other.close()

    def do(self, task: Task, on_progress: Callable[[Progress], object]) -> Any:
        """Return the result of a task, or its exception. Raises EOFError or OSError if the process
        dies, TimeoutError if it hangs."""
        self.connection.send(task)
        while self.connection.poll(_SILENCE):
            if not isinstance(message := self.connection.recv(), Progress):
                return message
            on_progress(message)
        raise TimeoutError

    def wait(self, until: float = 0.0) -> None:
        """Wait until the process has ended, which is forced at a time of time.monotonic."""
        try:
            self.process.join(max(0.0, until - time.monotonic()))
        finally:
            self.process.kill()
            self.process.join()


class Processes(Pool):
    """Worker processes, one for each of the `shares` of this machine; one that dies is started
    again. Ends them all at the end of the `with` block."""

    def __init__(
        self,
        shares: Sequence[Share],
        on_progress: Callable[[Progress], object] = lambda message: None,
    ) -> None:
        self._on_progress = on_progress
        self._workers = [_Worker(share) for share in shares]
        self._idle = SimpleQueue[_Worker | None]()
        self._lock, self._stopped = threading.Lock(), False
        for worker in self._workers:
            self._idle.put(worker)

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def count_workers(self) -> int:
        return len(self._workers)

    def run(self, task: Task) -> Any:
        outcome: Any = None
        for _ in range(ATTEMPTS):
            worker = self._idle.get()
            if worker is None:
                self._idle.put(None)  # for others that wait
                raise TaskStopped(task.name)
            try:
                outcome = worker.do(task, self._on_progress)
            except (EOFError, OSError) as error:
                why = "hangs" if isinstance(error, TimeoutError) else "died"
                outcome = InputError(f"its worker, process {worker.process.pid}, {why}")
                self._restart(worker)
            finally:
                self._idle.put(worker)
            if isinstance(outcome, TaskStopped) or not isinstance(outcome, Exception):
                break
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    def _restart(self, worker: _Worker) -> None:
        with self._lock:
            if not self._stopped:
                worker.wait()
                worker.start()

    def stop(self) -> None:
        with self._lock:
            self._stopped = True
        while not self._idle.empty():
            self._idle.get()
        self._idle.put(None)
        for worker in self._workers:
            worker.process.terminate()
        until = time.monotonic() + PATIENCE
        for worker in self._workers:
            worker.wait(until)


def _serve(tasks: Connection) -> None:
    """Do the tasks that come, until the other process ends or SIGTERM comes."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    lock = threading.Lock()

    def send(message: object) -> None:
        with lock:
            tasks.send(message)

    stopping = False

    def stop(*_: object) -> NoReturn:
        nonlocal stopping
        stopping = True
        ignore_signals(["SIGTERM"])  # a second one would cut off what the task writes
        raise KeyboardInterrupt

    with suppress(KeyboardInterrupt, EOFError, OSError), handle_signals(stop, ["SIGTERM"]):
        set_up_worker()
        while not stopping:
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
