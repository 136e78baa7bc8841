"""Run tasks on workers, and return the outcomes of jobs that consist of such tasks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeVar

from apf.cluster.task_side import PULSE
from apf.cluster.workers import MOST_WORKERS

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
