"""Devices with the work-groups of the other kind: all can do both, as far as they have room."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import pytest

from cl import Device, InputError

#: Items of a work-group on a CPU that is taken for a GPU: PoCL compiles 512 of them, which are a
#: GPU's in some kernels, for half as long again. More than a body has cones, so that some idle.
_ITEMS = 32


class _SmallGroups:
    """A device's handle that allows work-groups of `_ITEMS` at most."""

    max_work_group_size = _ITEMS

    def __init__(self, handle: Any) -> None:
        self._handle = handle

    def __getattr__(self, name: str) -> Any:
        return getattr(self._handle, name)


def other_kind(device: Device) -> Device:
    """The same device, taken for a CPU if it is a GPU, for a GPU if not."""
    other = Device(device.handle)
    other.info = replace(device.info, kind="cpu" if device.is_gpu else "gpu")
    if not device.is_gpu:
        other.handle = _SmallGroups(device.handle)
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
