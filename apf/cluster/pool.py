"""Run tasks on workers, also workflows of several in which later tasks need the results of earlier
ones, and return their outcomes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

from apf.cluster.task_side import TaskStopped

#: Number of times that a task is tried.
ATTEMPTS = 3
#: Interval at which joining and leaving workers are noticed, s.
_PULSE = 0.5


@dataclass(frozen=True)
class Task:
    """A unit of work for one worker.

    name: unique. work: a module's function, called as `work(progress, *arguments)`, see
    `TaskProgress`. arguments: plain values.
    """

    name: str
    work: Callable[..., object]
    arguments: tuple[object, ...] = ()


#: A finished task with its result, or its exception.
Outcome = tuple[Task, Any]


class Pool(ABC):
    """Runs tasks on workers, as many at a time as there are workers.

    A task that fails, or whose worker dies, is repeated; the exception of the third attempt is its
    outcome, and does not stop the others. Subclasses say where the workers are.
    """

    def __init__(self) -> None:
        self._waiting, self._attempts = deque[Task](), Counter[str]()
        self._more: Iterator[Task] = iter(())

    @abstractmethod
    def count_workers(self) -> int:
        """Return how many tasks the workers can do at a time."""

    @abstractmethod
    def count_running(self) -> int:
        """Return the number of tasks that workers are doing."""

    @abstractmethod
    def submit(self, task: Task, attempt: int) -> None:
        """Have a free worker begin a task."""

    @abstractmethod
    def poll(self, seconds: float) -> Sequence[Outcome]:
        """Return the tasks that have finished, after a wait of at most `seconds`."""

    @abstractmethod
    def stop(self) -> None:
        """Stop the running tasks after their current frames."""

    def add(self, task: Task) -> None:
        """Add a task; also possible while iterating over `outcomes`."""
        self._waiting.append(task)

    def give_up(self, task: Task) -> None:
        """Let the outcome of a task count, however often it was tried."""
        self._attempts[task.name] = ATTEMPTS

    def outcomes(self, tasks: Iterable[Task] = ()) -> Generator[Outcome, None, None]:
        """Yield every task with its result, or its exception, as they finish.

        tasks: further ones, each requested when a worker is free. Closing the generator, or an
        interrupt, stops the running tasks. Raises InputError if all workers are lost.
        """
        self._more = iter(tasks)
        try:
            while self._submit() or self.count_running():
                for task, outcome in self.poll(_PULSE):
                    failed = isinstance(outcome, Exception) and not isinstance(outcome, TaskStopped)
                    if failed and self._attempts[task.name] < ATTEMPTS:
                        self.add(task)
                    else:
                        yield task, outcome
        finally:
            self.stop()

    def _submit(self) -> bool:
        """Give tasks to the free workers; return whether there was one."""
        begun = False
        while self.count_running() < max(1, self.count_workers()):
            task = self._waiting.popleft() if self._waiting else next(self._more, None)
            if task is None:
                break
            self._attempts[task.name] += 1
            self.submit(task, self._attempts[task.name])
            begun = True
        return begun


#: A generator of workflow steps: it yields tasks that may run in parallel, receives their results
#: in that order, and returns the final result. If one of them fails, its exception is raised at the
#: `yield`.
Workflow = Generator[list[Task], list[Any], Any]


@dataclass
class _Course:
    steps: Workflow
    tasks: list[str] = field(default_factory=list)
    outcomes: dict[str, object] = field(default_factory=dict)

    def advance(self, pool: Pool, error: Exception | None = None) -> None:
        """Add the tasks of the next step. Raises StopIteration with the final result."""
        results = [self.outcomes[name] for name in self.tasks]
        begun = bool(self.tasks)
        step = self.steps.throw(error) if error else self.steps.send(results if begun else None)  # type: ignore[arg-type]
        self.tasks, self.outcomes = [task.name for task in step], {}
        for task in step:
            pool.add(task)


def run_workflows(
    pool: Pool, workflows: Mapping[str, Workflow]
) -> Generator[tuple[str, Any], None, None]:
    """Run the workflows; yield the name of each with its result, or its exception, as they
    finish."""
    running = {name: _Course(steps) for name, steps in workflows.items()}
    for course in running.values():
        course.advance(pool)
    with closing(pool.outcomes()) as outcomes:
        for task, outcome in outcomes:
            name = next((n for n, course in running.items() if task.name in course.tasks), None)
            if name is None:
                continue  # another task of this workflow has failed
            course = running[name]
            course.outcomes[task.name] = outcome
            failed = outcome if isinstance(outcome, Exception) else None
            try:
                if failed or len(course.outcomes) == len(course.tasks):
                    course.advance(pool, failed)
            except StopIteration as end:
                del running[name]
                yield name, end.value
            except Exception as error:
                del running[name]
                yield name, error
