"""The PoCL of the package pocl-binary-distribution 3.0, on processors that it does not know.

That wheel is of 2022 and the last one. Its LLVM 14 names a newer processor (AMD's Zen 4 and later,
for example) "generic", and its own compiler refuses that name; where a virtual machine hides
features of a processor that it does know, it compiles for instructions that are not there. Its
library of built-in functions, however, is chosen by the features alone. So the right name is that
of the processor which the chosen library was compiled for: with any other one, vectors are passed
in other registers than the library expects.

PoCL 3.0 has no setting for the name, so `set_target` writes it into PoCL's device object. This
module can go when PyPI has a newer PoCL, or when the wheel is no dependency any more.
"""

from __future__ import annotations

import ctypes
import os
import shutil
from collections.abc import Set
from pathlib import Path
from typing import Any

#: `driver_version` of that wheel; the system's PoCL never has it.
_DRIVER = "3.0-rc2"
_PLATFORM = "Portable Computing Language"
#: Byte offset of `char *llvm_cpu` in the wheel's `struct _cl_device_id`.
_OFFSET = 640
_LONGEST_NAME = 64

#: The processor that each built-in library of the wheel was compiled for ("target-cpu" of its
#: functions), and the features of /proc/cpuinfo by which PoCL chooses it: the last that fits
#: (getX86KernelLibName in its pocl_llvm_utils.cc).
LIBRARIES = (
    ("athlon64", "sse2"),
    ("core2", "ssse3 cx16"),
    ("penryn", "sse4_1 cx16"),
    ("sandybridge", "avx cx16 popcnt"),
    ("ivybridge", "avx cx16 popcnt f16c"),
    ("bdver1", "avx cx16 popcnt xop fma4"),
    ("haswell", "avx avx2 cx16 popcnt abm f16c fma bmi1 bmi2"),
    ("skylake-avx512", "avx512f"),
)


def is_wheel(device: Any) -> bool:
    """Return whether a pyopencl device is that of the wheel."""
    return bool(
        device.platform.name.strip() == _PLATFORM and device.driver_version.strip() == _DRIVER
    )


def explain_missing_linker(device: object) -> str | None:
    """Return what is wrong if `device` is the wheel's and the machine has no linker, which PoCL
    calls for each kernel that it builds: without one, it ends the process."""
    if is_wheel(device) and shutil.which("ld") is None:
        return (
            "PoCL finds no linker `ld` to build kernels with; expected one in PATH "
            "(Debian: binutils), or --device numpy"
        )
    return None


def fitting_target(features: Set[str] | None = None) -> str | None:
    """Return the processor that the wheel's built-in library for these features was compiled for.

    features: of /proc/cpuinfo, this machine's by default. None if no library fits.
    """
    features = processor_features() if features is None else features
    fits = [name for name, needed in LIBRARIES if set(needed.split()) <= features]
    return fits[-1] if fits else None


def processor_features() -> frozenset[str]:
    """Return the features of this machine's processor, by their names in /proc/cpuinfo."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return frozenset()
    lines = (line.partition(":") for line in text.splitlines())
    return next((frozenset(v.split()) for k, _, v in lines if k.strip() == "flags"), frozenset())


def read_target(device: Any) -> str | None:
    """Return the processor's name that the wheel compiles for, None if it is not found."""
    try:
        memory = os.open("/proc/self/mem", os.O_RDONLY)  # reading a wrong address there is no crash
    except OSError:
        return None
    try:
        pointer = os.pread(memory, 8, device.int_ptr + _OFFSET)
        text = os.pread(memory, _LONGEST_NAME, int.from_bytes(pointer, "little"))
    except (OSError, OverflowError):
        return None
    finally:
        os.close(memory)
    name, end, _ = text.partition(b"\0")
    known = end and name.replace(b"-", b"").replace(b".", b"").isalnum()
    return name.decode() if known else None


def set_target(device: Any, name: str) -> None:
    """Make the wheel compile for the processor `name`, from the next program on.

    Raises ValueError if the device object is not the wheel's.
    """
    if not is_wheel(device) or read_target(device) is None:
        raise ValueError(f"{device.name.strip()} is not the device of pocl-binary-distribution 3.0")
    libc = ctypes.CDLL(None)
    libc.strdup.restype = ctypes.c_void_p  # never freed: PoCL keeps it for good
    ctypes.c_void_p.from_address(device.int_ptr + _OFFSET).value = libc.strdup(name.encode())
