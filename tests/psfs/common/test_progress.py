"""Threads: `psfs.common.progress`."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from psfs.common.progress import map_in_threads


def test_results_come_in_order_from_threads_that_do_not_run_far_ahead() -> None:
    taken: list[int] = []

    def items() -> Iterator[int]:
        for number in range(20):
            taken.append(number)
            yield number

    for number, (result, thread) in enumerate(
        map_in_threads(lambda item: (item**2, threading.get_ident()), items(), most=3)
    ):
        assert result == number**2
        assert thread != threading.get_ident()
        assert len(taken) <= number + 1 + 3


def test_an_error_is_raised_in_its_turn_and_ends_the_work() -> None:
    results = map_in_threads(lambda item: 1 // item, [2, 1, 0, 3])
    assert [next(results), next(results)] == [0, 1]
    with pytest.raises(ZeroDivisionError):
        next(results)
