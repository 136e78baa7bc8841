"""Programs: the kernels' sources and defines, and what was built of them in a context."""

from __future__ import annotations

import logging
import os
import re
import threading
import time
import warnings
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
import pyopencl

from cl.launch import Kernel
from cl.signature import signatures

Define = int | float | str


def build_options(defines: Mapping[str, Define]) -> str:
    """Return the compiler's options for `defines`, in alphabetical order."""
    listed = (f"-D {key}={_literal(value)}" for key, value in sorted(defines.items()))
    # No -cl-fast-relaxed-math: the twins are compared to float rounding.
    return " ".join(["-cl-std=CL1.2", *listed])


def build_program(context: Any, source: str, options: str) -> Any:
    """Build a program without printing the compiler's warnings, which users cannot mend.

    `scripts/check_kernels.py` shows them to developers. Raises pyopencl.RuntimeError with the
    compiler's errors.
    """
    # PyOpenCL looks this up without a default where its cache cannot be written, as on a full disk.
    os.environ.setdefault("PYOPENCL_CACHE_FAILURE_FATAL", "")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pyopencl.Program(context, source).build(options=f"{options} -w")


@cache
def kernel_source(stage: str) -> str:
    """Return the text of `cl/kernels/<stage>.cl` with its quoted headers inlined.

    A stage "package:file" is `<file>.cl` in another installed package, whose headers are those of
    `cl/kernels`. Headers are inlined because a driver's binary cache may not notice that one
    changed; `#line` marks keep the compiler's messages pointing at the files.
    """
    return _inline(f"{stage}.cl", set())


def _inline(filename: str, seen: set[str]) -> str:
    seen.add(filename)
    package, _, name = filename.rpartition(":")
    folder = resources.files(package) if package else resources.files("cl") / "kernels"
    text = (folder / name).read_text()
    lines = [f'#line 1 "{filename}"']
    for number, line in enumerate(text.splitlines(), 1):
        include = re.match(r'\s*#include\s+"([^"]+)"', line)
        if not include:
            lines.append(line)
        elif include[1] not in seen:
            lines += [_inline(include[1], seen), f'#line {number + 1} "{filename}"']
        else:
            lines.append("")
    return "\n".join(lines)


def _literal(value: Define) -> str:
    # float(): NumPy's own numbers write themselves as np.float64(...).
    return f"{float(value)!r}f" if isinstance(value, (float, np.floating)) else str(value)


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
                self._kernels[named] = Kernel(program, name, file, signatures(source, file))
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
