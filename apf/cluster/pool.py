"""Tasks on the workers of a cluster, and what became of each."""

from __future__ import annotations

import uuid
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from apf.cluster.connection import ATTEMPTS, dask_distributed
from apf.cluster.task_side import Progress, perform, stop
from cl import InputError

#: Seconds after which workers that came or went are noticed.
_PULSE = 0.5
_GONE = "the scheduler has gone; what is finished is kept: give the command again"


@dataclass(frozen=True)
class Task:
    """What one worker does at a time. name: unlike any other's. work: a function of a module, which
    is called as `work(progress, *arguments)`, see `TaskProgress`; all of them plain values."""

    name: str
    work: Callable[..., Any]
    arguments: tuple[Any, ...] = ()


class Pool:
    """Does tasks on the workers of `client`; as many at a time as these have threads.

    A task whose worker dies is done again by another, one that raises is tried three times; what
    it raised last is its outcome then and stops no other.
    """

    def __init__(self, client: Any, on_progress: Callable[[Progress], object] | None = None):
        self._client, self._waiting = client, deque[Task]()
        self._more: Iterator[Task] = iter(())
        self._under_way: dict[Any, Task] = {}
        self.batch = uuid.uuid4().hex
        if on_progress is not None:
            client.subscribe_topic(self.batch, lambda event: on_progress(Progress(**event[1])))

    def add(self, task: Task) -> None:
        """Do the task, too; also while `outcomes` is iterated over."""
        self._waiting.append(task)

    def outcomes(self, tasks: Iterable[Task] = ()) -> Generator[tuple[Task, Any], None, None]:
        """Yield every task with what it returned, or the exception, as they are done. tasks: more
        of them, each asked for when a worker is free.

        When it is closed, or an interrupt comes, tasks under way are told to stop. Raises
        InputError where the scheduler has gone.
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
        """Return what was done meanwhile, with its outcomes."""
        distributed = dask_distributed()
        try:
            self._submit()
            if not self._under_way:
                return []
            done = distributed.wait([*self._under_way], _PULSE, "FIRST_COMPLETED").done
            # A result is lost with the worker that holds it; then the task is done again.
            whole = [future for future in done if future.status not in ("pending", "lost")]
            return [(self._under_way.pop(future), _outcome(future)) for future in whole]
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
                perform, task.name, self.batch, task.work, task.arguments,
                key=key, retries=ATTEMPTS - 1, pure=False,
            )  # fmt: skip
            self._under_way[future] = task

    def _stop(self) -> None:
        """Tell the workers to stop what is under way; their threads end after the frame in work."""
        if self._under_way and self._client.status == "running":
            with suppress(OSError, TimeoutError):  # the scheduler may have gone
                self._client.run(stop, self.batch, on_error="ignore")
                self._client.cancel(list(self._under_way), force=True)
        self._under_way.clear()


def _outcome(future: Any) -> Any:
    if future.status == "finished":
        return future.result()
    if future.status == "error":
        error = future.exception()
        if isinstance(error, dask_distributed().KilledWorker):
            return InputError(f"its worker died {ATTEMPTS} times, at last on {error.last_worker}")
        return error
    raise InputError(_GONE)
