"""List of the machine's OpenCL devices."""

from __future__ import annotations

import logging
import re
import sys
from dataclasses import dataclass, replace
from typing import Any

import pyopencl

from cl.errors import pip_command
from cl.folders import replace_unwritable_caches
from cl.probe import Probe, probe
from cl.vendors import register_packaged_drivers

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class DeviceInfo:
    """Properties of a device that `psfs devices` prints."""

    name: str
    platform: str
    driver: str
    kind: str  # "gpu", "cpu" or "other"
    compute_units: int
    memory: int  # bytes
    #: The result of trying it; None if it was not tried.
    probe: Probe | None = None


def list_devices(afresh: bool = False) -> list[DeviceInfo]:
    """Return all OpenCL devices of this machine, with the result of trying each: GPUs first, then
    CPUs by Intel's runtime, then other CPUs. afresh: try them now and ignore cached results."""
    tried = ((device_info(handle), probe(handle, afresh)) for handle in ranked_devices())
    return [replace(info, probe=found) for info, found in tried]


def working_devices() -> list[Any]:
    """Return pyopencl's devices that work, in the order of `list_devices`, for `Device`."""
    return [handle for handle in ranked_devices() if probe(handle).fault is None]


def ranked_devices() -> list[Any]:
    """Return pyopencl's devices, working or not: GPUs first, then CPUs by Intel's runtime, which is
    the fastest there, then the others; of these, newer drivers and more compute units first."""

    def rank(device: Any) -> tuple[Any, ...]:
        is_gpu = bool(device.type & pyopencl.device_type.GPU)
        by_intel = not is_gpu and "Intel" in device.platform.name
        release = [int(number) for number in re.findall(r"\d+", device.driver_version)[:2]]
        newer = [-number for number in release] if not is_gpu else []
        return (not is_gpu, not by_intel, newer, -device.max_compute_units)

    return sorted(_opencl_devices(), key=rank)


def _opencl_devices() -> list[Any]:
    replace_unwritable_caches()
    register_packaged_drivers()
    try:
        platforms = pyopencl.get_platforms()
    except pyopencl.Error:  # the loader reports "no platform" as an error
        return []
    devices: dict[int, Any] = {}  # by handle: a driver may be found in two places
    for platform in platforms:
        try:
            devices.update({device.int_ptr: device for device in platform.get_devices()})
        except pyopencl.Error:
            log.warning("the OpenCL platform %s has no usable device", platform.name)
    return list(devices.values())


def where_to_get_opencl(system: str = sys.platform) -> str:
    """Return advice on which OpenCL to install; system: a value of `sys.platform`."""
    gpu = "a GPU's OpenCL comes with its driver"
    if system == "win32":
        return f"{gpu}; for the CPU install Intel's CPU Runtime for OpenCL Applications"
    if system == "darwin":
        return (
            "install pyopencl with pocl, for the CPU, or ocl_icd_wrapper_apple, for Apple's own, "
            "from conda-forge"
        )
    return (
        f"{gpu}; for the CPU install pocl-binary-distribution with pip, or "
        f"{pip_command('intel')}; on other processors than x86-64 the system's package "
        "pocl-opencl-icd"
    )


def device_info(device: Any) -> DeviceInfo:
    """Return the properties of a pyopencl device."""
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
