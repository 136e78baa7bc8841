"""Threads that decode: those of the views of a frame, and one that runs ahead of its reader."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, wait
from contextlib import closing
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


def prefetch(items: Generator[T, None, None], depth: int) -> Iterator[T]:
    """Yield the items of a generator that a thread runs at most `depth` items ahead.

    An exception in the thread is raised here, after the items before it. When the consumer stops
    early, the generator is closed, in its thread, before this returns.
    """
    ready: queue.Queue[tuple[bool, T | BaseException | None]] = queue.Queue(maxsize=depth)
    stop = threading.Event()

    def put(more: bool, value: T | BaseException | None) -> None:
        while not stop.is_set():
            try:
                ready.put((more, value), timeout=0.05)
                return
            except queue.Full:
                continue

    def produce() -> None:
        try:
            with closing(items):
                for item in items:
                    put(True, item)
                    if stop.is_set():
                        return
            put(False, None)
        except BaseException as error:  # raised again in the consumer
            put(False, error)

    thread = threading.Thread(target=produce, name="psfs-decode", daemon=True)
    thread.start()
    try:
        while True:
            more, value = ready.get()
            if isinstance(value, BaseException):
                raise value
            if not more:
                return
            yield value  # type: ignore[misc]
    finally:
        stop.set()
        thread.join()
