"""Times with their statistics, and the devices that they are measured on."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

import numpy as np
import pyopencl

from cl import Device, InputError
from cl.listing import working_devices
from psfs.common.system import changed_environment

#: The environment variable for PoCL's number of threads, before version 4.
_POCL_THREADS = "POCL_MAX_PTHREAD_COUNT"


@dataclass(frozen=True)
class Timing:
    """Duration, ms, of repeated runs, in their order: median and quartiles."""

    samples: tuple[float, ...]

    @property
    def median(self) -> float:
        return self._percentile(50)

    @property
    def low(self) -> float:
        return self._percentile(25)

    @property
    def high(self) -> float:
        return self._percentile(75)

    def __str__(self) -> str:
        digits = 3 if self.median < 1 else 2 if self.median < 10 else 1
        return f"{self.median:.{digits}f} [{self.low:.{digits}f}, {self.high:.{digits}f}]"

    def _percentile(self, share: float) -> float:
        return float(np.percentile(self.samples, share))


@dataclass(frozen=True)
class Place:
    """A device to measure on; `cores`: of a CPU."""

    label: str
    handle: Any
    cores: int | None = None

    def device(self, profile: bool = False) -> Device:
        return Device(self.handle, profile=profile)


def places() -> list[Place]:
    """Return every OpenCL device of this process, GPUs first. Raises InputError if there is
    none."""
    found = []
    for handle in working_devices():
        name, units = handle.name.strip(), handle.max_compute_units
        if handle.type & pyopencl.device_type.CPU:
            label = f"{name}, {units} core{'s' * (units > 1)}"
            found.append(Place(label, handle, units))
        else:
            found.append(Place(name, handle))
    if not found:
        raise InputError("no OpenCL device; expected at least a CPU's")
    return found


def apart(environ: Mapping[str, str], function: Callable[..., Any], *args: Any) -> Any:
    """Call `function(*args)` of a module in a new process with `environ` added to its
    environment."""
    cores = int(environ.get(_POCL_THREADS, 0))
    with (
        changed_environment(environ),
        ProcessPoolExecutor(1, get_context("spawn"), _keep_to_cores, (cores,)) as pool,
    ):
        return pool.submit(function, *args).result()


def only_cores(cores: int) -> dict[str, str]:
    """Return the environment for `apart` in which OpenCL and its host use `cores` cores of the
    CPU."""
    return {_POCL_THREADS: str(cores), "POCL_CPU_MAX_CU_COUNT": str(cores)}


def _keep_to_cores(cores: int) -> None:
    """Pin this process to its first `cores` cores, if given. Intel's runtime obeys that; PoCL obeys
    its environment."""
    if cores and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])


def cpu_place() -> Place:
    """Return the CPU of this process. Raises InputError if OpenCL has none."""
    for place in places():
        if place.cores:
            return place
    raise InputError("no OpenCL device that is a CPU; expected PoCL's or Intel's")
