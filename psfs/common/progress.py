"""Long work: what it reports while it runs, and threads."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

Item = TypeVar("Item")
Result = TypeVar("Result")

#: Yield items, of which there is a number, and show under a name how many have come.
Track = Callable[[Iterable[Any], int, str], Iterable[Any]]


def track_silently(items: Iterable[Any], total: int, name: str) -> Iterable[Any]:
    """Yield the items and show nothing."""
    return items


@cache
def _thread_pools() -> ThreadpoolController:
    return ThreadpoolController()  # which looks at every library of the process


def one_blas_thread() -> Any:
    """Return a context in which products of matrices use one thread, as small ones had better."""
    return _thread_pools().limit(limits=1, user_api="blas")


def map_in_threads(
    function: Callable[[Item], Result], items: Iterable[Item], most: int = 8
) -> Iterator[Result]:
    """Yield the results of a function for all items, in their order, from up to `most` threads,
    which work at most that many items ahead.

    Pays where the function leaves Python's lock, as NumPy and OpenCV do on large arrays. After an
    error or an interrupt no further call begins; those that have begun are not waited for.
    """
    n_threads = min(most, os.cpu_count() or 1)
    pool, begun = ThreadPoolExecutor(n_threads), deque[Future[Result]]()
    try:
        for item in items:
            if len(begun) == n_threads:
                yield begun.popleft().result()
            begun.append(pool.submit(function, item))
        while begun:
            yield begun.popleft().result()
        pool.shutdown()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
