"""A thread that runs ahead of its reader."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

T = TypeVar("T")


def prefetch(items: Generator[T, None, None], depth: int) -> Iterator[T]:
    """Yield the items of a generator that a thread runs at most `depth` items ahead.

    An exception in the thread is raised here, after the items before it. When the consumer stops
    early, the generator is closed before this returns: by the consumer, as nothing may be submitted
    while garbage is collected, where another `submit` may hold the lock.
    """
    thread, begun, end = ThreadPoolExecutor(1, "psfs-decode"), deque[Future[Any]](), object()
    try:
        while True:
            while len(begun) <= depth:
                begun.append(thread.submit(next, items, end))
            item = begun.popleft().result()
            if item is end:
                return
            yield item
    finally:
        for later in begun:
            later.cancel()
        thread.shutdown()
        items.close()
