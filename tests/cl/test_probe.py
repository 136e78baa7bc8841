"""Devices are tried before they are used; those that do not work are passed over and named."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.commands import run_python

import cl.listing
import cl.probe
from cl import Device, DeviceError, NumpyDevice, Probe, select_device
from cl.folders import replace_unwritable_caches
from cl.listing import working_devices
from cl.probe import expected_sums, probe

SOURCE = Path(__file__).parents[1] / "helpers" / "broken_driver.c"


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file that holds the results, in a folder of this test's own."""
    monkeypatch.setattr(cl.probe, "cache_folder", lambda: tmp_path / "cache")
    return tmp_path / "cache" / "devices.json"


@pytest.fixture
def tries(monkeypatch: pytest.MonkeyPatch) -> list[str | None]:
    """The processors that devices are tried with from now on; each try finds them working."""
    found: list[str | None] = []

    def run(handle: object, target: str | None) -> Probe:
        found.append(target)
        return Probe(None, target)

    monkeypatch.setattr(cl.probe, "try_apart", run)
    return found


@pytest.mark.parity("common/probe.check")
def test_the_kernels_compute_what_they_are_checked_against(device: Device) -> None:
    values = np.linspace(0.1, 2.0, 80, dtype=np.float32)
    sums, count = device.zeros(5, np.float32), device.zeros(1, np.int32)
    check = device.kernel("common/probe", "check", GROUP=16)
    given = device.to_device(values)
    device.launch(check, (80,), (16,), n=80, values=given, sums=sums, count=count)()
    np.testing.assert_allclose(sums.get(), expected_sums(values), rtol=1e-4, atol=1e-3)
    assert count.get() == 5


def test_a_device_is_tried_once(device: Device, cache: Path, tries: list[str | None]) -> None:
    assert probe(device.handle) == probe(device.handle)
    assert len(tries) == 1
    probe(device.handle, afresh=True)
    assert len(tries) == 2


@pytest.mark.parametrize("text", ["", "{", "[]", '{"x": 1}', '{"x": {"speed": 1}}'])
def test_a_damaged_cache_counts_for_nothing(
    device: Device, cache: Path, tries: list[str | None], text: str
) -> None:
    cache.parent.mkdir()
    cache.write_text(text)
    assert probe(device.handle).fault is None and len(tries) == 1
    assert len(json.loads(cache.read_text())) == 1


def test_a_fault_is_forgotten_after_an_hour(
    device: Device, cache: Path, tries: list[str | None]
) -> None:
    found = probe(device.handle)
    for age, expected in ((60, 1), (4000, 2)):
        old = replace(found, fault="broken", tried_at=time.time() - age)
        cl.probe.write_cache({cl.probe.cache_key(device.handle): old})
        assert (probe(device.handle).fault == "broken") == (expected == 1)
        assert len(tries) == expected


def test_a_driver_that_ends_the_process_is_a_fault(
    device: Device, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cl.probe, "find_position", lambda handle: (99, 0))  # no such platform
    found = probe(device.handle, afresh=True)
    assert found.fault is not None and "IndexError" in found.fault and "\n" not in found.fault


def test_files_of_the_current_folder_do_not_stand_for_modules(
    device: Device, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("json", "runpy", "numpy"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit(7)\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    assert probe(device.handle, afresh=True).fault is None


@pytest.mark.skipif(os.name == "nt", reason="Windows has no owners")
@pytest.mark.parametrize(("mode", "used"), [(0o700, True), (0o777, False)])
def test_a_temporary_cache_that_others_may_write_to_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: int, used: bool
) -> None:
    usual = tmp_path / f"psfs-cache-{os.getuid()}"
    usual.mkdir()
    usual.chmod(mode)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/none")
    monkeypatch.setenv("POCL_CACHE_DIR", "/proc/none")
    replace_unwritable_caches()
    for variable in ("XDG_CACHE_HOME", "POCL_CACHE_DIR"):
        place = Path(os.environ[variable])
        assert (place == usual) == used and not place.stat().st_mode & 0o022


def test_kernels_are_launched_without_a_home(tmp_path: Path) -> None:
    """PyOpenCL opens a database in the cache at the first kernel, after the device is listed."""
    places = {"HOME": "/proc/none", "XDG_CACHE_HOME": "", "TMPDIR": str(tmp_path)}
    places["POCL_CACHE_DIR"] = "/dev/null/x"
    code = "from cl import launch, select_device; select_device('auto'); launch._keep_code()"
    done = run_python("-c", code, **places)
    assert done.code == 0 and "Error" not in done.err, done


@pytest.mark.skipif(os.name == "nt", reason="Windows has no limit of file sizes")
def test_a_cache_without_room_for_kernels_is_refused(tmp_path: Path) -> None:
    code = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000));"
        "from psfs.cli import main; sys.exit(main(['devices']))"
    )
    ended = run_python("-c", code, XDG_CACHE_HOME=str(tmp_path), POCL_CACHE_DIR=None)
    assert ended.code == 2 and "no room for compiled kernels" in ended.err


@pytest.mark.skipif(os.name == "nt", reason="Windows has no signals")
@pytest.mark.parametrize(("name", "kept"), [("SIGTERM", 0), ("SIGKILL", 0), ("SIGSEGV", 1)])
def test_a_process_that_somebody_else_ends_is_no_fault_of_the_driver(
    device: Device, cache: Path, monkeypatch: pytest.MonkeyPatch, name: str, kept: int
) -> None:
    run = subprocess.run

    def end(command: list[str], **options: Any) -> Any:
        code = f"import os, signal; os.kill(os.getpid(), signal.{name})"
        return run([sys.executable, "-c", code], **options)

    monkeypatch.setattr(cl.probe.subprocess, "run", end)
    found = probe(device.handle)
    assert found.fault is not None and (name in found.fault) == (kept == 0)
    assert len(cl.probe.read_cache()) == kept


def test_devices_that_fail_are_passed_over_and_named(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    handles = working_devices()
    faults = {id(handle): "its compiler fails" for handle in handles[:-1]}

    def found(handle: object, afresh: bool = False) -> Probe:
        return Probe(faults.get(id(handle)))

    monkeypatch.setattr(cl.listing, "ranked_devices", lambda: handles)
    monkeypatch.setattr(cl.device, "ranked_devices", lambda: handles)
    monkeypatch.setattr(cl.device, "probe", found)
    chosen = select_device("auto")
    assert isinstance(chosen, Device) and chosen.handle == handles[-1]
    assert len(caplog.records) == len(handles) - 1
    faults[id(handles[-1])] = "it is broken"
    for choice in ("auto", "cpu", handles[-1].name):
        if choice != "cpu" or chosen.info.kind == "cpu":
            with pytest.raises(DeviceError, match="does not work: it"):
                select_device(choice)
    assert select_device("numpy") == NumpyDevice()


# A driver that lists a GPU and cannot build, beside those of this machine ------------------------


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Variables by which OpenCL's loader finds such a driver."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or not sys.platform.startswith("linux"):
        pytest.skip("no C compiler on Linux to make a broken driver with")
    folder = tmp_path_factory.mktemp("vendors")
    library = folder / "libbroken.so"
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, SOURCE], check=True)
    (folder / "broken.icd").write_text(f"{library}\n")
    known = os.environ.get("OCL_ICD_VENDORS", "/etc/OpenCL/vendors")
    for path in Path(known).glob("*.icd"):
        shutil.copy(path, folder)
    return {"OCL_ICD_VENDORS": str(folder), "COLUMNS": "200"}  # no name in the table is cut


def test_a_broken_device_is_listed_beside_those_that_work(broken: dict[str, str]) -> None:
    ended = run_python("-m", "psfs.cli", "devices", **broken)
    if "Broken GPU" not in ended.out:
        pytest.skip("OpenCL's loader here does not read OCL_ICD_VENDORS")
    assert ended.code == 0
    rows = {line.split("│")[1].strip(): line for line in ended.out.splitlines() if "│" in line}
    assert "no" in rows["Broken GPU"].split() and "yes" in rows[Device.best().name]
    assert "unknown target CPU" in ended.out + ended.err


def test_a_broken_device_is_refused_by_name_and_passed_over_by_auto(
    broken: dict[str, str], walk: Path, tmp_path: Path
) -> None:
    flags = ["-o", str(tmp_path / "out"), "--frames", "0:1", "--device", "broken gpu"]
    named = run_python("-m", "psfs.cli", "reconstruct", walk, *flags, **broken)
    if "no OpenCL device matches" in named.err:
        pytest.skip("OpenCL's loader here does not read OCL_ICD_VENDORS")
    assert named.code == 2 and "please report" not in named.err
    (line,) = named.err.splitlines()
    assert "Broken GPU does not work" in line and "unknown target CPU" in line
    use = "from cl import Device; assert Device.best().zeros(3, 'f4').get().sum() == 0"
    auto = run_python("-c", use, **broken)
    assert auto.code == 0 and "Broken GPU does not work" in auto.err
