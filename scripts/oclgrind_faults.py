#!/usr/bin/env python3
"""Show by kernels of one line what Oclgrind's detector of uninitialised values reports wrongly.

    scripts/oclgrind_faults.py        # Debian's, or the driver that OCLGRIND_ICD names

Each case copies numbers that the host, or a kernel, wrote to a buffer in one of the ways that
there are; the last one copies numbers that nobody wrote, and alone deserves reports.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyopencl
from check_kernels import ICD

N = 16
COPY = "__kernel void copy(__global const int *from, __global int *to) {%s}"
EACH = "to[get_global_id(0)] = from[get_global_id(0)];"
#: Element 11 of a vector, picked by a shuffle of constant places.
SHUFFLE = "vstore4(vload16(0, from).s89ab, 0, to);"


def make_empty(queue: pyopencl.CommandQueue, numbers: int = N) -> pyopencl.Buffer:
    return pyopencl.Buffer(queue.context, pyopencl.mem_flags.READ_WRITE, 4 * numbers)


def write_all(queue: pyopencl.CommandQueue) -> pyopencl.Buffer:
    buffer = make_empty(queue)
    pyopencl.enqueue_copy(queue, buffer, np.arange(N, dtype=np.int32))
    return buffer


def write_half_anew(queue: pyopencl.CommandQueue) -> pyopencl.Buffer:
    buffer = write_all(queue)
    pyopencl.enqueue_copy(queue, buffer, np.zeros(N // 2, np.int32))
    return buffer


def fill(queue: pyopencl.CommandQueue) -> pyopencl.Buffer:
    buffer = make_empty(queue)
    pyopencl.enqueue_fill_buffer(queue, buffer, np.int32(7), 0, 4 * N)
    return buffer


def replace_smaller(queue: pyopencl.CommandQueue) -> pyopencl.Buffer:
    """Return a buffer in the place of a smaller one that was freed, written by a kernel."""
    small = make_empty(queue, 1)
    pyopencl.enqueue_copy(queue, small, np.zeros(1, np.int32))
    queue.finish()
    small.release()
    buffer = make_empty(queue)
    copy(queue, EACH, write_all(queue), buffer)
    return buffer


def copy(
    queue: pyopencl.CommandQueue, body: str, source: pyopencl.Buffer, to: pyopencl.Buffer
) -> None:
    """Run the kernel of this body: one item, or one for each number."""
    kernel = pyopencl.Program(queue.context, COPY % body).build("-cl-opt-disable").copy
    kernel(queue, (N if body == EACH else 1,), None, source, to)
    queue.finish()


CASES: dict[str, tuple[Callable[[pyopencl.CommandQueue], pyopencl.Buffer], str]] = {
    "written at once": (write_all, EACH),
    "element 11 by a shuffle": (write_all, SHUFFLE),
    "half of it written anew": (write_half_anew, EACH),
    "filled by OpenCL's command": (fill, EACH),
    "in the place of a smaller one": (replace_smaller, EACH),
    "never written": (make_empty, EACH),
}


def run_case(name: str) -> None:
    """Run a case on the first device, which writes its reports to stderr."""
    device = pyopencl.get_platforms()[0].get_devices()[0]
    assert "Oclgrind" in device.name, f"{device.name} is not Oclgrind's"
    queue = pyopencl.CommandQueue(pyopencl.Context([device]))
    make, body = CASES[name]
    copy(queue, body, make(queue), make_empty(queue))


def main() -> int:
    if len(sys.argv) > 1:
        run_case(sys.argv[1])
        return 0
    right = True
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "oclgrind.icd").write_text(f"{ICD}\n")
        environment = os.environ | {"OCL_ICD_VENDORS": folder, "OCLGRIND_UNINITIALIZED": "1"}
        environment |= {"PYOPENCL_NO_CACHE": "1", "OCLGRIND_NUM_THREADS": "1"}
        for name in CASES:
            command = [sys.executable, __file__, name]
            ended = subprocess.run(command, env=environment, capture_output=True, text=True)
            if ended.returncode:
                print(ended.stderr[-300:], file=sys.stderr)
                return ended.returncode
            reports = ended.stderr.count("Uninitialized value")
            wrong = (reports > 0) != (name == "never written")
            right &= not wrong
            print(f"{name:30s} {reports:3d} reports{', wrong' if wrong else ''}")
    return 0 if right else 1


if __name__ == "__main__":
    sys.exit(main())
