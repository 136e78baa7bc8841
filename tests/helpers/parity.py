"""Which kernels a test launches and what they are given: for comparisons with their twins.

A test that compares kernels with their twins says so, `@pytest.mark.parity("stage.kernel", ...)`,
and fails unless it launches them all (conftest.py). With `pytest --without-kernels -m parity` each
such test runs once more for each of its kernels, which is left out: it must fail then.
"""

import ast
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
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


def marked_in(tests: Path) -> dict[str, set[str]]:
    """Return the tests that are marked for each kernel, read from the tests' text."""
    found: dict[str, set[str]] = {}
    for path in sorted(tests.rglob("test_*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef):
                for decorator in node.decorator_list:  # and what its parameters are marked with
                    for kernel in (k for n in ast.walk(decorator) for k in _kernels_of(n)):
                        found.setdefault(kernel, set()).add(f"{path.name}::{node.name}")
    return found


def _kernels_of(node: ast.AST) -> list[str]:
    if not isinstance(node, ast.Call) or ast.unparse(node.func) != "pytest.mark.parity":
        return []
    return [ast.literal_eval(argument) for argument in node.args]
