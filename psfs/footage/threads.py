"""A thread that runs ahead of its reader."""

from __future__ import annotations

import queue
import threading
from collections.abc import Generator, Iterator
from contextlib import closing
from typing import TypeVar

T = TypeVar("T")


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
