"""Devices with the work-groups of the other kind: all can do both, as far as they have room."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest

from cl import Device, InputError


def other_kind(device: Device) -> Device:
    """The same device, taken for a CPU if it is a GPU, for a GPU if not."""
    other = Device(device.handle)
    other.info = replace(device.info, kind="cpu" if device.is_gpu else "gpu")
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
