"""Contexts and the programs that were built in them."""

from __future__ import annotations

import logging
import threading
import time
from typing import Any
from weakref import WeakValueDictionary

import pyopencl

from cl.launch import Kernel
from cl.program import build_program
from cl.signature import signatures

log = logging.getLogger(__name__)


class Programs:
    """A context of one OpenCL device, and its programs, each of which is built once."""

    def __init__(self, handle: Any) -> None:
        self.context = pyopencl.Context([handle])
        self._programs: dict[tuple[str, str, str], Any] = {}
        self._kernels: dict[tuple[str, str, str, str], Kernel] = {}
        self._building = threading.Lock()

    def kernel(self, source: str, name: str, file: str, options: str) -> Kernel:
        """Return the kernel `name` of a text built with the compiler's `options`; `file` names the
        text in errors. Raises DeviceError if it has no such kernel."""
        key = (file, source, options)
        with self._building:
            if key not in self._programs:
                started = time.perf_counter()
                self._programs[key] = build_program(self.context, source, options)
                log.info("built %s in %.2f s", file, time.perf_counter() - started)
            named = (*key, name)
            if named not in self._kernels:
                program = self._programs[key]
                found = signatures(source, file)
                self._kernels[named] = Kernel(program, name, file, found, (source, options))
            return self._kernels[named]


#: By the handles of devices; programs live as long as a `Device` that uses them.
_SHARED: WeakValueDictionary[Any, Programs] = WeakValueDictionary()
_MAKING = threading.Lock()


def shared_programs(handle: Any) -> Programs:
    """Return the programs that all `Device`s of one device share.

    They are built again only when no such `Device` is left: a load of a program takes PoCL 50 ms
    even from its cache, and a tracker has 20 of them.
    """
    with _MAKING:
        programs = _SHARED.get(handle)
        if programs is None:
            programs = _SHARED[handle] = Programs(handle)
        return programs
