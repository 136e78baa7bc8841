"""Shared by the tests: every OpenCL device, and the folders of real data."""

from __future__ import annotations

from pathlib import Path

import pytest

from cl import Device, list_devices, select_device

SHARED = Path(__file__).parents[1].parent / "shared" / "data"


def shared_data(name: str) -> Path:
    """The folder `name` of the shared data; the test is skipped where it is absent."""
    folder = SHARED / name
    if not folder.is_dir():
        pytest.skip(f"needs the data folder {folder}")
    return folder


@pytest.fixture(scope="session", params=[info.name for info in list_devices()])
def device(request: pytest.FixtureRequest) -> Device:
    """Each OpenCL device of this machine in turn."""
    chosen = select_device(request.param)
    assert isinstance(chosen, Device)
    return chosen
