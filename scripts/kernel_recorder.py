"""A plugin of pytest for check_kernels.py: which parity tests there are, and what they build and
launch on the first device, which is a GPU if RECORD_AS_GPU is set; fills that Oclgrind's detector
of uninitialised values sees.

KERNEL_RECORD names the JSON file that is written: {"cases": [[test, [kernel, ...]], ...]} when
tests are collected only, else {"device": name, "programs": [[file, source, options], ...],
"launched": [...]}.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl
import pytest
from helpers import parity

from apf.synthetic import render
from cl import Device, listing
from cl.probe import Probe
from cl.program import build_options

_working_devices = listing.working_devices
listing.working_devices = lambda: _working_devices()[:1]
if "RECORD_AS_GPU" in os.environ:
    Device.is_gpu = property(lambda device: True)
else:  # trying its device takes Oclgrind minutes, and so do the 128 x 128 texels of a shadow
    listing.probe = lambda handle, afresh=False: Probe(None)
    render.SHADOW_SIZE, render.SHADOW_STEP = 16, 8 * render.SHADOW_STEP


def pytest_make_parametrize_id(val: Any, argname: str) -> str | None:
    """Name tests alike on all devices."""
    return "device" if argname == "device" else None


def pytest_collection_finish(session: pytest.Session) -> None:
    if session.config.option.collectonly:
        cases = [
            (item.nodeid, [name for mark in item.iter_markers("parity") for name in mark.args])
            for item in session.items
        ]
        _write({"cases": cases})


@pytest.fixture(scope="session", autouse=True)
def _record() -> Iterator[None]:
    """Write the programs and the launches of the session to the file."""
    programs: set[tuple[str, str, str]] = set()
    compiled = Device.compile_kernel

    def recording(device: Device, source: str, name: str, file: str, /, **defines: Any) -> Any:
        programs.add((file, source, build_options(defines)))
        return compiled(device, source, name, file, **defines)

    with pytest.MonkeyPatch.context() as patch, parity.launched() as names:
        patch.setattr(Device, compiled.__name__, recording)
        patch.setattr(pyopencl, "enqueue_fill_buffer", fill_by_copy)
        yield
    device = listing.working_devices()[0].name
    _write({"device": device, "programs": sorted(programs), "launched": sorted(names)})


def fill_by_copy(queue: Any, buffer: Any, pattern: Any, offset: int, size: int) -> Any:
    """Fill from the host, because Oclgrind reports memory filled by OpenCL's own command as
    uninitialised."""
    host = np.tile(np.atleast_1d(pattern), size // np.asarray(pattern).nbytes)
    return pyopencl.enqueue_copy(queue, buffer, host, dst_offset=offset)


def _write(found: dict[str, Any]) -> None:
    Path(os.environ["KERNEL_RECORD"]).write_text(json.dumps(found))
