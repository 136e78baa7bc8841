"""Browsers without a graphics chip are distinguished from others by the time of a picture."""

from types import SimpleNamespace
from typing import Any

import pytest

from psfs.page.watch import draws_slowly


def make_server(now: list[float], *answers: float | Exception) -> Any:
    """A server whose browsers take so many seconds for a picture, or do not give one."""

    def client(answer: float | Exception) -> Any:
        def get_render(height: int, width: int, timeout: float) -> None:
            if isinstance(answer, Exception):
                raise answer
            now[0] += answer

        return SimpleNamespace(get_render=get_render)

    clients = {number: client(answer) for number, answer in enumerate(answers)}
    return SimpleNamespace(get_clients=lambda: clients)


@pytest.mark.parametrize(
    ("answers", "slow"),
    [
        ((), False),
        ((0.0, 0.01), False),
        ((0.0, 0.45), True),
        ((TimeoutError("hidden"), RuntimeError("closed")), False),
    ],
)
def test_slow_browsers_are_found(
    answers: tuple[float | Exception, ...], slow: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr("psfs.page.watch.time.perf_counter", lambda: now[0])
    assert draws_slowly(make_server(now, *answers)) is slow
