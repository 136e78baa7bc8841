"""Intel's CPU runtime is found where pip installed it."""

import os
from pathlib import Path

import pytest

import cl.vendors
from cl.vendors import intel_library, register_packaged_drivers


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
