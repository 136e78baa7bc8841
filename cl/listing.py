"""Which OpenCL devices there are."""

from __future__ import annotations

import logging
import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyopencl

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
    _mend_cache()
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


def _mend_cache() -> None:
    """Let PoCL, which has no device without a cache that it can write, have one in a temporary
    folder."""
    home = os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    cache = Path(os.environ.get("POCL_CACHE_DIR") or Path(home) / "pocl")
    try:
        cache.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=cache):
            return
    except (OSError, RuntimeError):
        mended = Path(tempfile.gettempdir()) / f"pocl-cache-{os.getuid()}"
        log.warning("PoCL's cache %s cannot be written; %s is taken", cache, mended)
        os.environ["POCL_CACHE_DIR"] = str(mended)


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
