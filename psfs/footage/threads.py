"""Threads that decode the views of a frame at the same time."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Future, wait
from typing import Any, TypeVar

T = TypeVar("T")

#: s after which what has not come counts as hanging.
PATIENCE = 60.0


class HangingError(Exception):
    """A call has not returned; `number`: which of those that were made together."""

    def __init__(self, number: int) -> None:
        super().__init__(f"call {number} hangs")
        self.number = number


class Threads:
    """Daemon threads: one that hangs does not keep the process alive, as those of
    concurrent.futures do."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._work: queue.SimpleQueue[
            tuple[Future[Any], Callable[..., Any], tuple[Any, ...]] | None
        ] = queue.SimpleQueue()

    def __enter__(self) -> Threads:
        for number in range(self._count):
            name = f"psfs-decode-{number}"
            threading.Thread(target=self._serve, name=name, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        for _number in range(self._count):
            self._work.put(None)

    def map(self, call: Callable[..., T], *arguments: Iterable[Any]) -> list[T]:
        """Return what `call` returns for each of the arguments, once all calls have ended. Raises
        the first one's exception, and HangingError where one does not end within `PATIENCE` s."""
        futures: list[Future[T]] = []
        for each in zip(*arguments, strict=True):
            futures.append(Future())
            self._work.put((futures[-1], call, each))
        _, hanging = wait(futures, PATIENCE)
        if hanging:
            raise HangingError(min(futures.index(future) for future in hanging))
        return [future.result() for future in futures]

    def _serve(self) -> None:
        while (item := self._work.get()) is not None:
            future, call, arguments = item
            try:
                future.set_result(call(*arguments))
            except BaseException as error:  # handed to whom it was called for
                future.set_exception(error)
