"""Run tasks on the workers of a cluster, also workflows of several in which later tasks need the
results of earlier ones, and return their outcomes."""

from __future__ import annotations

import uuid
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass, field
from typing import Any

from apf.cluster.connection import ATTEMPTS, import_distributed
from apf.cluster.task_side import Progress, run_task, stop
from cl import InputError

#: Interval at which joining and leaving workers are noticed, s.
_PULSE = 0.5
_GONE = "the scheduler has gone; what is finished is kept: give the command again"


@dataclass(frozen=True)
class Task:
    """A unit of work for one worker.

    name: unique. work: a module's function, called as `work(progress, *arguments)`, see
    `TaskProgress`. arguments: plain values.
    """

    name: str
    work: Callable[..., object]
    arguments: tuple[object, ...] = ()


class Pool:
    """Runs tasks on the workers of `client`, as many at a time as these have threads.

    A task whose worker dies is repeated on another. One that raises is tried three times; its last
    exception is its outcome, and does not stop the others.
    """

    def __init__(self, client: Any, on_progress: Callable[[Progress], object] | None = None):
        self._client, self._waiting = client, deque[Task]()
        self._more: Iterator[Task] = iter(())
        self._under_way: dict[Any, Task] = {}
        self.batch = uuid.uuid4().hex
        if on_progress is not None:
            client.subscribe_topic(self.batch, lambda event: on_progress(Progress(**event[1])))

    def add(self, task: Task) -> None:
        """Add a task; also possible while iterating over `outcomes`."""
        self._waiting.append(task)

    def outcomes(self, tasks: Iterable[Task] = ()) -> Generator[tuple[Task, object], None, None]:
        """Yield every task with its result, or its exception, as they finish.

        tasks: further ones, each requested when a worker is free. Closing the generator, or an
        interrupt, stops the running tasks. Raises InputError if the connection to the scheduler is
        lost.
        """
        self._more = iter(tasks)
        try:
            while True:
                done = self._next()
                if not done and not self._under_way:
                    return
                yield from done
        finally:
            self._stop()

    def _next(self) -> list[tuple[Task, Any]]:
        """Return the tasks that have finished since the last call, with their outcomes."""
        distributed = import_distributed()
        try:
            self._submit()
            if not self._under_way:
                return []
            done = distributed.wait([*self._under_way], _PULSE, "FIRST_COMPLETED").done
            # A result is lost with the worker that holds it; the task is then repeated.
            whole = [future for future in done if future.status not in ("pending", "lost")]
            return [(self._under_way.pop(future), _get_outcome(future)) for future in whole]
        except TimeoutError:
            return []
        except (distributed.CancelledError, distributed.comm.CommClosedError):
            raise InputError(_GONE) from None

    def _submit(self) -> None:
        threads = sum(self._client.nthreads().values())
        while len(self._under_way) < max(1, threads):
            task = self._waiting.popleft() if self._waiting else next(self._more, None)
            if task is None:
                return
            key = f"{task.name}-{self.batch}"
            future = self._client.submit(
                run_task, task.name, self.batch, task.work, task.arguments,
                key=key, retries=ATTEMPTS - 1, pure=False,
            )  # fmt: skip
            self._under_way[future] = task

    def _stop(self) -> None:
        """Stop the running tasks on the workers; their threads end after the current frame."""
        if self._under_way and self._client.status == "running":
            with suppress(OSError, TimeoutError):  # the scheduler may be gone
                self._client.run(stop, self.batch, on_error="ignore")
                self._client.cancel(list(self._under_way), force=True)
        self._under_way.clear()


def _get_outcome(future: Any) -> Any:
    if future.status == "finished":
        return future.result()
    if future.status == "error":
        error = future.exception()
        if isinstance(error, import_distributed().KilledWorker):
            worker = getattr(error.last_worker, "address", error.last_worker)
            return InputError(f"its worker died {ATTEMPTS} times, at last {worker}")
        return error
    raise InputError(_GONE)


#: A generator of workflow steps: it yields tasks that may run in parallel, receives their results
#: in that order, and returns the final result. If one of them fails, its exception is raised at the
#: `yield`.
Workflow = Generator[list[Task], list[Any], Any]


@dataclass
class _UnderWay:
    course: Workflow
    tasks: list[str] = field(default_factory=list)
    outcomes: dict[str, object] = field(default_factory=dict)


def run_workflows(
    pool: Pool, courses: Mapping[str, Workflow]
) -> Generator[tuple[str, Any], None, None]:
    """Run the workflows; yield the name of each with its result, or its exception, as they
    finish."""
    owners: dict[str, str] = {}
    begun: dict[str, _UnderWay] = {}

    def add(name: str, tasks: list[Task]) -> None:
        begun[name].tasks, begun[name].outcomes = [task.name for task in tasks], {}
        for task in tasks:
            owners[task.name] = name
            pool.add(task)

    for name, course in courses.items():
        begun[name] = _UnderWay(course)
        add(name, next(course))
    with closing(pool.outcomes()) as outcomes:
        for task, outcome in outcomes:
            name = owners[task.name]
            under_way = begun.get(name)
            if under_way is None:
                continue  # another task of this workflow has failed
            under_way.outcomes[task.name] = outcome
            try:
                if isinstance(outcome, BaseException):
                    add(name, under_way.course.throw(outcome))
                elif len(under_way.outcomes) == len(under_way.tasks):
                    found = [under_way.outcomes[one] for one in under_way.tasks]
                    add(name, under_way.course.send(found))
            except StopIteration as end:
                del begun[name]
                yield name, end.value
            except Exception as error:
                del begun[name]
                yield name, error
