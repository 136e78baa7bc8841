"""Waiting for what goes on beside a test."""

import time
from collections.abc import Callable


def wait_for(done: Callable[[], object], seconds: float = 600) -> None:
    until = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < until
        time.sleep(0.05)
