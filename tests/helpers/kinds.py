"""Devices with the work-groups of the other kind: all can do both, as far as they have room."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import pytest

from cl import Device, InputError
from cl.launch import Kernel
from cl.program import Programs

#: Items of a work-group on a CPU that is taken for a GPU: PoCL compiles them sooner than the 512 of
#: some kernels on a GPU. More than a body has cones, so that some idle.
_ITEMS = 32


class _SmallGroups:
    """A device's handle that allows work-groups of `_ITEMS` at most."""

    max_work_group_size = _ITEMS

    def __init__(self, handle: Any) -> None:
        self._handle = handle

    def __getattr__(self, name: str) -> Any:
        return getattr(self._handle, name)


class _Unoptimised:
    """Programs of a device that are built without optimisation, in a fraction of the time: what
    nobody runs on this device."""

    def __init__(self, programs: Programs) -> None:
        self._programs = programs

    def kernel(self, source: str, name: str, file: str, options: str) -> Kernel:
        return self._programs.kernel(source, name, file, f"{options} -cl-opt-disable")


def other_kind(device: Device) -> Device:
    """The same device, taken for a CPU if it is a GPU, for a GPU if not; that as nobody runs it,
    with small work-groups and without optimisation."""
    other: Any = Device(device.handle)
    other.info = replace(device.info, kind="cpu" if device.is_gpu else "gpu")
    if not device.is_gpu:
        other.handle, other.programs = _SmallGroups(device.handle), _Unoptimised(other.programs)
    return other


@contextmanager
def skipped_without_room(device: Device) -> Iterator[None]:
    """GPUs may have less local memory than the CPUs' work-groups take."""
    try:
        yield
    except InputError as error:
        if not device.is_gpu or "local memory" not in str(error):
            raise
        pytest.skip(str(error))
