"""Threads that decode the views of a frame in parallel."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Future, wait
from typing import Any, TypeVar

T = TypeVar("T")

#: Time after which a call that has not returned counts as hanging, s.
TIMEOUT_S = 60.0


class HangingError(Exception):
    """A call has not returned; `number` is its index among those made together."""

    def __init__(self, number: int) -> None:
        super().__init__(f"call {number} hangs")
        self.number = number


class Threads:
    """A pool of daemon threads.

    A hanging one does not keep the process alive, as those of concurrent.futures would.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._work: queue.SimpleQueue[
            tuple[Future[Any], Callable[..., object], tuple[object, ...]] | None
        ] = queue.SimpleQueue()

    def __enter__(self) -> Threads:
        for number in range(self._count):
            name = f"psfs-decode-{number}"
            threading.Thread(target=self._serve, name=name, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        for _number in range(self._count):
            self._work.put(None)

    def map(self, call: Callable[..., T], *arguments: Iterable[object]) -> list[T]:
        """Run `call` for each of the arguments and return the results when all calls have ended.

        Raises the first exception, and HangingError if a call does not end within `TIMEOUT_S` s.
        """
        futures: list[Future[T]] = []
        for each in zip(*arguments, strict=True):
            futures.append(Future())
            self._work.put((futures[-1], call, each))
        _, hanging = wait(futures, TIMEOUT_S)
        if hanging:
            raise HangingError(min(futures.index(future) for future in hanging))
        return [future.result() for future in futures]

    def _serve(self) -> None:
        while (item := self._work.get()) is not None:
            future, call, arguments = item
            try:
                future.set_result(call(*arguments))
            except BaseException as error:  # raised again in the caller
                future.set_exception(error)
