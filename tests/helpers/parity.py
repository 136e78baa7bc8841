"""Which kernels a test launches and what they are given: for comparisons with their twins.

A test that compares kernels with their twins says so, `@pytest.mark.parity("stage.kernel", ...)`,
and fails unless it launches them all (conftest.py). With `pytest --without-kernels -m parity` each
such test runs once more for each of its kernels, which is left out: it must fail then.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from cl import Array, Device, Launch

Enqueue = Callable[[Launch], Any]


@dataclass(frozen=True)
class Traced:
    """The arguments of a launch by name, arrays as they were before and after it."""

    before: dict[str, Any]
    after: dict[str, Any]


def kernel_of(launch: Launch) -> str:
    """Return "stage.kernel"."""
    return f"{launch.kernel.file.removesuffix('.cl')}.{launch.kernel.name}"


@contextmanager
def instead(enqueue: Callable[[Launch, Enqueue], Any]) -> Iterator[None]:
    """Have `enqueue` called with each launch and with what enqueues it."""
    original = Launch.__call__
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Launch, "__call__", lambda launch: enqueue(launch, original))
        yield


@contextmanager
def launched() -> Iterator[set[str]]:
    """Collect the kernels that are launched in the meantime."""
    names: set[str] = set()

    def enqueue(launch: Launch, original: Enqueue) -> Any:
        names.add(kernel_of(launch))
        return original(launch)

    with instead(enqueue):
        yield names


@contextmanager
def traced(kernel: str) -> Iterator[list[Traced]]:
    """Keep copies of what each launch of "stage.kernel" gets and leaves behind."""
    found: list[Traced] = []

    def enqueue(launch: Launch, original: Enqueue) -> Any:
        if kernel_of(launch) != kernel:
            return original(launch)
        before = _copied(launch.arguments)
        event = original(launch)
        found.append(Traced(before, _copied(launch.arguments)))
        return event

    with instead(enqueue):
        yield found


def _copied(arguments: dict[str, Any]) -> dict[str, Any]:
    return {k: v.get() if isinstance(v, Array) else v for k, v in arguments.items()}


@contextmanager
def left_out(kernel: str) -> Iterator[None]:
    """Enqueue all but "stage.kernel"; new arrays are zero, so that no earlier result is found."""
    empty = Device.empty

    def zeros(device: Device, *arguments: Any) -> Array:
        array = empty(device, *arguments)
        if array.shape and np.prod(array.shape):
            array.fill(0)
        return array

    def enqueue(launch: Launch, original: Enqueue) -> Any:
        return None if kernel_of(launch) == kernel else original(launch)

    with instead(enqueue), pytest.MonkeyPatch.context() as patch:
        patch.setattr(Device, "empty", zeros)
        yield
