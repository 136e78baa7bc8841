"""The limits of devices, and the conditions of measurements."""

from __future__ import annotations

import os
import platform
from dataclasses import asdict, dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from apf.timings.measure import Place, cpu_place
from cl import list_devices

_FMA = """
__kernel void fma_chain(__global float *x) {
    const int i = get_global_id(0);
    float16 a = x[i], b = a + 1, c = a + 2, d = a + 3, e = a + 4, f = a + 5;
    for (int k = 0; k < 512; ++k) {
        a = a * 0.999f + 0.1f; b = b * 0.999f + 0.1f; c = c * 0.999f + 0.1f;
        d = d * 0.999f + 0.1f; e = e * 0.999f + 0.1f; f = f * 0.999f + 0.1f;
    }
    a += b + c + d + e + f;
    x[i] = a.s0 + a.s1 + a.s2 + a.s3 + a.s4 + a.s5 + a.s6 + a.s7 +
           a.s8 + a.s9 + a.sa + a.sb + a.sc + a.sd + a.se + a.sf;
}
__kernel void copy(__global const float4 *x, __global float4 *y) {
    const int i = get_global_id(0);
    y[i] = x[i];
}
"""


def fewer_cores(place: Place) -> list[int]:
    """Return 1, 2, 4, ... below the cores of the CPU that `cpu_place` returns; nothing for other
    devices."""
    if place.cores is None or place.label != cpu_place().label:
        return []
    return [2**k for k in range(place.cores.bit_length()) if 2**k < place.cores]


@dataclass(frozen=True)
class Limits:
    """The measured limits of a device: bytes and floating-point operations per second."""

    bytes_per_s: float
    flops_per_s: float

    def ms(self, nbytes: float, flops: float) -> float:
        """Return the least time, ms, for this number of bytes and operations."""
        return 1e3 * max(nbytes / self.bytes_per_s, flops / self.flops_per_s)


def measured_limits(place: Place) -> Limits:
    """Measure them by a copy of 256 MB and by 96 independent chains of multiply-add per
    work-item."""
    device = place.device(profile=True)
    size = 2**25
    x, y = device.zeros(size, np.float32), device.zeros(size, np.float32)
    copy = device.launch(
        device.compile_kernel(_FMA, "copy", "_FMA"), (size // 4,), (256,), x=x, y=y
    )
    items = 2**20 if device.is_gpu else 2**14
    chain = device.launch(device.compile_kernel(_FMA, "fma_chain", "_FMA"), (items,), (256,), x=x)
    for _ in range(5):
        copy()
        chain()
    assert device.profiler is not None
    ms = device.profiler.collect()
    return Limits(
        2 * 4 * size / (1e-3 * min(ms["copy"])),
        items * 512 * 96 * 2 / (1e-3 * min(ms["fma_chain"])),
    )


#: Packages whose versions are reported, also if they are absent.
_PACKAGES = (
    *("psfs-apf", "numpy", "scipy", "opencv-python-headless", "pyopencl"),
    *("pocl-binary-distribution", "trimesh", "matplotlib"),
)


def environment() -> dict[str, Any]:
    """Return the conditions of the measurements."""
    return {
        "cpu": _cpu_name(),
        "cores": len(os.sched_getaffinity(0)),
        "load": os.getloadavg()[0],
        "system": platform.platform(),
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in _PACKAGES},
        "devices": [asdict(replace(info, probe=None)) for info in list_devices()],
    }


def _cpu_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(x.split(":")[1].strip() for x in lines if "model name" in x)
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
