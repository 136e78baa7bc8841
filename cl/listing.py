"""Which OpenCL devices there are."""

from __future__ import annotations

import importlib.util
import logging
import os
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyopencl

from cl.errors import DeviceError

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class DeviceInfo:
    """What `psfs devices` prints about a device."""

    name: str
    platform: str
    driver: str
    kind: str  # "gpu", "cpu" or "other"
    compute_units: int
    memory: int  # bytes


def list_devices() -> list[DeviceInfo]:
    """All OpenCL devices of this machine, GPUs first, then by compute units, most first."""
    return [device_info(device) for device in ranked_devices()]


def ranked_devices() -> list[Any]:
    """pyopencl's devices, in the order of `list_devices`."""

    def rank(device: Any) -> tuple[bool, int]:
        return (not device.type & pyopencl.device_type.GPU, -device.max_compute_units)

    return sorted(_opencl_devices(), key=rank)


def _opencl_devices() -> list[Any]:
    _mend_caches()
    try:
        platforms = pyopencl.get_platforms()
    except pyopencl.Error:  # the loader reports "no platform" as an error
        return []
    devices = []
    for platform in platforms:
        try:
            devices += platform.get_devices()
        except pyopencl.Error:
            log.warning("the OpenCL platform %s has no usable device", platform.name)
    return devices


def _mend_caches() -> None:
    """Let PoCL and PyOpenCL, which do nothing without a cache that they can write, have one in a
    temporary folder."""
    places = {"XDG_CACHE_HOME": "~/.cache", "POCL_CACHE_DIR": None}
    for variable, usual in places.items():
        place = os.environ.get(variable) or usual
        if place is not None and not _writable(place):
            mended = str(Path(tempfile.gettempdir()) / f"psfs-cache-{os.getuid()}")
            log.warning("the cache %s cannot be written; %s is taken", place, mended)
            os.environ[variable] = mended


def _writable(place: str) -> bool:
    try:
        folder = Path(place).expanduser()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except (OSError, RuntimeError):
        return False


def check_linker(info: DeviceInfo) -> None:
    """Raise DeviceError for PoCL's wheel on a machine without a linker, which PoCL calls when it
    builds a kernel: it would end the process."""
    pocl = info.kind == "cpu" and info.platform == "Portable Computing Language"
    wheel = pocl and importlib.util.find_spec("pocl_binary_distribution") is not None
    if wheel and shutil.which("ld") is None:
        raise DeviceError(
            f"{info.name}: PoCL finds no linker `ld` to build kernels with; expected one in PATH "
            "(Debian: binutils), or --device numpy"
        )


def where_to_get_opencl(system: str = sys.platform) -> str:
    """Return which OpenCL to install on a machine that has none; system: as `sys.platform`."""
    gpu = "a GPU's OpenCL comes with its driver"
    if system == "win32":
        return f"{gpu}; for the CPU install Intel's CPU Runtime for OpenCL Applications"
    if system == "darwin":
        return (
            "install pyopencl with pocl, for the CPU, or ocl_icd_wrapper_apple, for Apple's own, "
            "from conda-forge"
        )
    return (
        f"{gpu}; for the CPU install pocl-binary-distribution with pip, on other processors than "
        "x86-64 the system's package pocl-opencl-icd"
    )


def device_info(device: Any) -> DeviceInfo:
    kinds = {pyopencl.device_type.GPU: "gpu", pyopencl.device_type.CPU: "cpu"}
    kind = next((name for bit, name in kinds.items() if device.type & bit), "other")
    return DeviceInfo(
        name=device.name.strip(),
        platform=device.platform.name.strip(),
        driver=device.driver_version.strip(),
        kind=kind,
        compute_units=device.max_compute_units,
        memory=device.global_mem_size,
    )
