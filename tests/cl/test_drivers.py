"""Drivers that pip installs: PoCL's wheel on unknown processors, Intel's CPU runtime."""

import os
from pathlib import Path
from typing import Any

import pytest
from helpers.commands import run_python

import cl.probe
import cl.vendors
from cl import pocl_wheel
from cl.listing import ranked_devices
from cl.vendors import intel_library, register_packaged_drivers

FEATURES = Path("/proc/cpuinfo")


@pytest.fixture
def wheel() -> Any:
    """The wheel's device."""
    found = [device for device in ranked_devices() if pocl_wheel.is_wheel(device)]
    if not found:
        pytest.skip("pocl-binary-distribution 3.0 is not installed, or its driver not loaded")
    return found[0]


V2 = {"sse2", "ssse3", "cx16", "sse4_1", "sse4_2", "popcnt"}
V3 = V2 | {"avx", "f16c", "avx2", "abm", "fma", "bmi1", "bmi2"}


@pytest.mark.parametrize(
    ("features", "expected"),
    [
        ({"sse2"}, "athlon64"),
        ({"sse2", "ssse3", "cx16"}, "core2"),
        (V2, "penryn"),
        (V2 | {"avx"}, "sandybridge"),
        (V2 | {"avx", "f16c"}, "ivybridge"),
        (V2 | {"avx", "xop", "fma4"}, "bdver1"),
        (V3, "haswell"),
        (V3 - {"fma"}, "ivybridge"),
        (V3 | {"avx512f", "avx512bw"}, "skylake-avx512"),
        (set(), None),
    ],
)
def test_the_name_is_that_of_the_library_that_pocl_chooses(
    features: set[str], expected: str | None
) -> None:
    assert pocl_wheel.fitting_target(features) == expected


def test_a_processor_that_the_compiler_does_not_know_is_mended(
    wheel: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on AMD's Zen 5: LLVM 14 calls the processor "generic", which clang refuses."""
    code = """
import sys
from pathlib import Path
import cl.probe
from cl import Device, pocl_wheel
from cl.listing import ranked_devices
from cl.probe import examine, probe
cl.probe.cache_folder = lambda: Path(sys.argv[1])
run_apart = cl.probe.try_apart
cl.probe.try_apart = lambda handle, target: run_apart(handle, target or "generic")
(wheel,) = [device for device in ranked_devices() if pocl_wheel.is_wheel(device)]
pocl_wheel.set_target(wheel, "generic")
print(examine(wheel).fault)
found = probe(wheel)
print(found.fault, found.target, pocl_wheel.read_target(wheel))
assert probe(wheel) == found and probe(wheel, afresh=True).target == found.target
print(examine(wheel).fault)
"""
    ended = run_python("-c", code, tmp_path, PYOPENCL_NO_CACHE="1")
    assert ended.code == 0, ended
    before, during, after = ended.out.splitlines()
    fitting = pocl_wheel.fitting_target()
    assert "unknown target CPU 'generic'" in before
    assert during == f"None {fitting} {fitting}"
    assert after == "None"


def test_where_no_name_helps_it_is_said_what_to_install(
    wheel: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cl.probe, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(cl.probe, "try_apart", lambda *_: cl.probe.Probe("it fails"))
    fault = cl.probe.probe(wheel, afresh=True).fault
    assert fault is not None and "[intel]'" in fault and "pocl-opencl-icd" in fault


@pytest.fixture
def environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An environment without a word of drivers, with a cache in a folder that is returned."""
    for name in ("OCL_ICD_VENDORS", "OCL_ICD_FILENAMES"):
        monkeypatch.setenv(name, "x")  # restored afterwards, whatever is set in the meantime
        monkeypatch.delenv(name)
    monkeypatch.setattr(cl.vendors, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(cl.vendors.sys, "platform", "linux")
    register_packaged_drivers.cache_clear()
    return tmp_path


def test_without_the_extra_nothing_changes(
    environment: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cl.vendors, "_INTEL_PACKAGE", "no-such-package")
    assert intel_library() is None
    register_packaged_drivers()
    assert "OCL_ICD_VENDORS" not in os.environ and "OCL_ICD_FILENAMES" not in os.environ


def test_the_loader_gets_the_system_s_drivers_and_intel_s(
    environment: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = environment / "lib" / "libintelocl.so"
    system = environment / "system"
    system.mkdir()
    (system / "nvidia.icd").write_text("libnvidia-opencl.so.1\n")
    (system / "intel-cpu.icd").write_text("/opt/placeholder/lib/libintelocl.so\n")
    monkeypatch.setattr(cl.vendors, "intel_library", lambda: library)
    monkeypatch.setattr(cl.vendors, "_SYSTEM_FOLDERS", (system, environment / "absent"))
    register_packaged_drivers()
    folder = Path(os.environ["OCL_ICD_VENDORS"])
    named = sorted(path.read_text().strip() for path in folder.glob("*.icd"))
    assert named == sorted(["libnvidia-opencl.so.1", str(library)])
    assert os.environ["OCL_ICD_FILENAMES"] == str(library)


def test_a_user_s_own_folder_of_drivers_is_left_alone(
    environment: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cl.vendors, "intel_library", lambda: environment / "libintelocl.so")
    monkeypatch.setenv("OCL_ICD_VENDORS", "/mine")
    register_packaged_drivers()
    assert os.environ["OCL_ICD_VENDORS"] == "/mine"
