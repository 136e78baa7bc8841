"""Test whether an OpenCL device works, by running a small kernel in a process of its own.

A driver may list a device that it cannot use: its compiler does not know the processor, its
kernels compute nonsense, or it ends the process. So each device builds, runs and checks a small
kernel before it is used, in a process of its own. The result is kept in the user's cache while
driver and processor stay the same; a fault, which somebody may mend, for an hour. It is not kept if
somebody else ended the process.
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import json
import logging
import os
import platform
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import pyopencl

from cl import pocl_wheel
from cl.errors import pip_command
from cl.folders import cache_folder, write_whole
from cl.program import build_options, build_program, kernel_source
from cl.vendors import register_packaged_drivers

log = logging.getLogger(__name__)

#: Grows when devices have to be tried again: a change of the kernels, or of how they are judged.
_VERSION = 1
_GROUP = 16
_VALUES = 4096
#: Single precision, a sum of 256 values of the built-in functions.
_TOLERANCE = 1e-3
_SECONDS_AT_MOST = 180
_FAULT_HOLDS_SECONDS = 3600
_RUN_MODULE = (
    "import sys; sys.path = [place for place in sys.path if place]; import runpy; "
    "runpy.run_module(sys.argv.pop(1), run_name='__main__', alter_sys=True)"
)
#: Signals by which somebody else ends a process; SIGKILL is sent by Linux if memory is short, too.
_STOPPING = ("SIGHUP", "SIGINT", "SIGKILL", "SIGTERM")


@dataclass(frozen=True)
class Probe:
    """The result of trying a device.

    fault: why it cannot be used, a phrase of one line; None if it works.
    target: the processor that PoCL's wheel has to compile for, see `cl.pocl_wheel`; None if its own
        choice works, and for other drivers.
    tried_at: seconds since 1970.
    stopped: whether somebody else ended the process, so that nothing is known of the device.
    """

    fault: str | None
    target: str | None = None
    tried_at: float = field(default_factory=time.time)
    stopped: bool = False


def probe(handle: Any, afresh: bool = False) -> Probe:
    """Return whether the pyopencl device `handle` works, from the cache if it was tried before.

    A device of PoCL's wheel is made to compile for the processor that works. afresh: try it now,
    in any case.
    """
    missing = pocl_wheel.explain_missing_linker(handle)
    if missing:
        return Probe(missing)
    key = cache_key(handle)
    known = {} if afresh else read_cache()
    found = known.get(key)
    if found is None:
        found = _try(handle)
        if not found.stopped:
            write_cache({**read_cache(), key: found})
    if found.target is not None:
        pocl_wheel.set_target(handle, found.target)
    return found


def _try(handle: Any) -> Probe:
    """Probe `handle`; PoCL's wheel, if it fails, again with the processor name that fits."""
    found = try_apart(handle, None)
    if found.fault is None or found.stopped or not pocl_wheel.is_wheel(handle):
        return found
    fitting = pocl_wheel.fitting_target()
    if fitting is not None:
        mended = try_apart(handle, fitting)
        if mended.stopped:
            return mended
        if mended.fault is None:
            log.info("PoCL's wheel fails (%s); compiling for %s works", found.fault, fitting)
            return mended
    return Probe(
        f"{found.fault}; the wheel pocl-binary-distribution does not know this processor: "
        f"{pip_command('intel')}, or install the system's PoCL (Debian: pocl-opencl-icd)"
    )


def try_apart(handle: Any, target: str | None) -> Probe:
    """Probe `handle` in a process of its own, with kernels compiled for `target`."""
    numbers = [str(number) for number in find_position(handle)]
    words = [*numbers, *([] if target is None else [target])]
    command, environment = module_command("cl.probe", words)
    environment["PYOPENCL_NO_CACHE"] = "1"
    try:
        ended = subprocess.run(
            command, env=environment, capture_output=True, text=True, errors="replace",
            timeout=_SECONDS_AT_MOST, stdin=subprocess.DEVNULL, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return Probe(f"a first small kernel took more than {_SECONDS_AT_MOST} s")
    except OSError as error:
        return Probe(f"it cannot be tried: {error}")
    if ended.returncode == 0:
        return Probe(**json.loads(ended.stdout.splitlines()[-1]))
    for name in _STOPPING:
        if ended.returncode == -getattr(signal, name, 0):
            return Probe(f"{name} ended the process of a first small kernel", stopped=True)
    lines = [line.strip() for line in ended.stderr.splitlines() if line.strip()]
    last = f" ({lines[-1][:160]})" if lines else ""
    return Probe(f"its driver ended the process of a first small kernel{last}")


def module_command(module: str, words: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Return the command that runs a module as `python -m MODULE WORDS`, and its environment.

    It imports from the folders that this process does, and never from the current folder, which
    Python puts first: the names of files in a take would stand for modules.
    """
    path = os.pathsep.join(filter(None, sys.path))
    environment = os.environ | {"PYTHONPATH": path, "PYTHONSAFEPATH": "1"}
    return [sys.executable, "-c", _RUN_MODULE, module, *words], environment


def find_position(handle: Any) -> tuple[int, int]:
    """Return the numbers of a device's platform and of the device in it."""
    for number, found in enumerate(pyopencl.get_platforms()):
        if found == handle.platform:
            return number, found.get_devices().index(handle)
    raise ValueError(f"{handle.name} is no device of this machine")


# In the process of its own ------------------------------------------------------------------------


def _main() -> None:
    """Probe the device that the arguments name, and print the result as JSON."""
    parser = argparse.ArgumentParser(prog="cl.probe", description=__doc__)
    parser.add_argument("platform", type=int)
    parser.add_argument("device", type=int)
    parser.add_argument("target", nargs="?")
    args = parser.parse_args()
    register_packaged_drivers()
    handle = pyopencl.get_platforms()[args.platform].get_devices()[args.device]
    if args.target is not None:
        pocl_wheel.set_target(handle, args.target)
    print(json.dumps(asdict(examine(handle, args.target))))


def examine(handle: Any, target: str | None = None) -> Probe:
    """Build, run and check the kernels of `common/probe.cl` on a pyopencl device."""
    try:
        context = pyopencl.Context([handle])
        queue = pyopencl.CommandQueue(context)
        source = kernel_source("common/probe")
        options = build_options({"GROUP": _GROUP})
        program = build_program(context, source, options)
        wrong = _find_wrong_values(queue, program)
        return Probe(wrong, None if wrong else target)
    except pyopencl.Error as error:
        return Probe(f"a first small kernel fails: {_pick_line(error)}")


def _find_wrong_values(queue: Any, program: Any) -> str | None:
    """Return how the kernel `check` differs from `expected_sums`, None if it does not."""
    values = np.linspace(0.1, 2.0, _VALUES, dtype=np.float32)
    expected = expected_sums(values)
    given = _make_buffer(queue, values)
    sums, count = np.zeros(len(expected), np.float32), np.zeros(1, np.int32)
    buffers = [_make_buffer(queue, sums), _make_buffer(queue, count)]
    program.check(queue, (_VALUES,), (_GROUP,), np.int32(_VALUES), given, *buffers)
    for host, buffer in zip((sums, count), buffers, strict=True):
        pyopencl.enqueue_copy(queue, host, buffer)
    worst = float(np.abs(sums - expected).max())
    if not worst <= _TOLERANCE * float(np.abs(expected).max()):  # NaN fails too
        return f"its kernels compute nonsense: exp and sin are off by {worst:g}"
    if count[0] != len(expected):
        return f"its kernels compute nonsense: {count[0]} work-groups counted, not {len(expected)}"
    return None


def expected_sums(values: np.ndarray) -> np.ndarray:
    """Return the expected result (n / GROUP,) float64 of the kernel `check` for `values` (n,)."""
    x = values.astype(np.float64)[:, None] * np.arange(1, 17)
    return (np.exp(-x) + np.sin(x)).reshape(-1, _GROUP * 16).sum(1)


def _make_buffer(queue: Any, host: np.ndarray) -> Any:
    flags = pyopencl.mem_flags.READ_WRITE | pyopencl.mem_flags.COPY_HOST_PTR
    return pyopencl.Buffer(queue.context, flags, hostbuf=host)


def _pick_line(error: Exception) -> str:
    """Return the line of a driver's message that says what is wrong."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    telling = [line for line in lines if "error" in line.lower()]
    return (telling or lines or [type(error).__name__])[-1][:200]


# The cache ----------------------------------------------------------------------------------------


def cache_key(handle: Any) -> str:
    """Return the key of a result in the cache: driver, device and processor."""
    parts = [
        handle.platform.name, handle.platform.version, handle.name, handle.driver_version,
        pyopencl.VERSION_TEXT, _processor(), _VERSION,
    ]  # fmt: skip
    return " | ".join(str(part).strip() for part in parts)


@functools.cache
def _processor() -> str:
    """Return the processor's name and a digest of its features: a cache may be on a file server."""
    features = " ".join(sorted(pocl_wheel.processor_features()))
    return f"{platform.machine()} {hashlib.sha256(features.encode()).hexdigest()[:12]}"


def read_cache() -> dict[str, Probe]:
    """Return the cached results by key; empty if the file is damaged or of another version."""
    try:
        stored = json.loads((cache_folder() / "devices.json").read_text(encoding="utf-8"))
        known = {key: Probe(**value) for key, value in stored.items()}
        recent = time.time() - _FAULT_HOLDS_SECONDS
        return {key: p for key, p in known.items() if p.fault is None or p.tried_at > recent}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


def write_cache(known: dict[str, Probe]) -> None:
    text = json.dumps({key: asdict(value) for key, value in known.items()}, indent=1)
    try:
        write_whole(cache_folder() / "devices.json", text)
    except OSError as error:
        log.info("the results of trying the devices cannot be cached: %s", error)


if __name__ == "__main__":
    _main()
