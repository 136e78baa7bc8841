"""OpenCL devices: choice, memory, programs, transfers, staging and timings."""

import gc
import itertools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyopencl
import pytest
from helpers.kinds import other_kind

import cl.device
import cl.listing
import cl.program
from cl import Device, DeviceError, list_devices, select_device
from cl.listing import ranked_devices
from cl.program import kernel_source
from cl.staging import Ahead, Download, Upload, Uploads
from cl.workgroups import pack_defines, pack_size, pixel_pack


@pytest.fixture
def fresh(device: Device) -> Device:
    """The device with counters at zero."""
    return Device(device.handle)


FILL = """
__kernel void fill(int n, float value, __global float *out)
{
    const int i = get_global_id(0);
    if (i < n) out[i] = value * SCALE;
}
__kernel void sizes(__global int *out)
{
    if (get_global_id(0) == 0 && get_global_id(1) == 0) {
        out[0] = get_global_size(0);
        out[1] = get_global_size(1);
        out[2] = get_local_size(0);
        out[3] = get_local_size(1);
    }
}
"""


@pytest.fixture
def kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that stands for cl/kernels, with FILL as no other test builds it; its sources are
    not cached from test to test."""
    monkeypatch.setattr(cl.program.resources, "files", lambda package: tmp_path)
    monkeypatch.setattr(cl.device, "kernel_source", kernel_source.__wrapped__)
    (tmp_path / "kernels").mkdir()
    (tmp_path / "kernels" / "some.cl").write_text(f"{FILL}// {tmp_path}")
    return tmp_path / "kernels"


# Choice ------------------------------------------------------------------------------------------


def test_gpus_come_first_then_intel_s_runtime_then_newer_drivers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    gpu, cpu = pyopencl.device_type.GPU, pyopencl.device_type.CPU
    pocl, intel, nvidia = (
        SimpleNamespace(name=name)
        for name in ("Portable Computing Language", "Intel(R) OpenCL", "NVIDIA CUDA")
    )
    expected = [
        SimpleNamespace(type=kind, platform=by, driver_version=version, max_compute_units=units)
        for kind, by, version, units in (
            (gpu, nvidia, "580.159", 132),
            (gpu, intel, "26.1", 32),
            (cpu, intel, "2026.22.10", 4),
            (cpu, pocl, "5.0+debian", 4),
            (cpu, pocl, "3.1", 4),
            (cpu, pocl, "3.0-rc2", 8),
            (cpu, pocl, "3.0-rc2", 4),
        )
    ]
    monkeypatch.setattr(cl.listing, "_opencl_devices", lambda: expected[::-1])
    assert ranked_devices() == expected


def test_devices_are_found_by_kind_and_by_part_of_their_name(device: Device) -> None:
    for choice in (device.name, device.name[2:-1].upper(), device.info.platform.lower()):
        chosen = select_device(choice)
        assert isinstance(chosen, Device)
        assert choice.lower() in f"{chosen.name} {chosen.info.platform}".lower()
    if device.info.kind in ("cpu", "gpu"):
        chosen = select_device(device.info.kind)
        assert isinstance(chosen, Device) and chosen.info.kind == device.info.kind


@pytest.mark.parametrize("choice", ["auto", "gpu", "cpu", "anything"])
def test_machines_without_a_device_say_so(choice: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> list:
        raise pyopencl.LogicError("clGetPlatformIDs failed: PLATFORM_NOT_FOUND_KHR")

    monkeypatch.setattr(pyopencl, "get_platforms", none)
    assert list_devices() == []
    with pytest.raises(DeviceError, match="has no OpenCL device: a GPU's"):
        select_device(choice)


# Arrays and memory -------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [np.float32, np.uint8, np.int32])
def test_arrays_come_back_as_they_went(fresh: Device, kind: type) -> None:
    host = np.random.default_rng(0).integers(0, 200, (5, 3, 7)).astype(kind)
    array = fresh.to_device(host)
    assert (array.shape, array.dtype, array.nbytes) == (host.shape, host.dtype, host.nbytes)
    np.testing.assert_array_equal(array.get(), host)
    np.testing.assert_array_equal(array.get(2), host[:2])
    np.testing.assert_array_equal(fresh.to_device(host[:, ::2, ::-1]).get(), host[:, ::2, ::-1])
    array.set(host[::-1])
    np.testing.assert_array_equal(array.get(), host[::-1])
    array.fill(7)
    np.testing.assert_array_equal(array.get(), np.full_like(host, 7))
    assert not fresh.zeros((4, 5), kind).get().any()


def test_arrays_of_another_shape_or_type_are_refused(fresh: Device) -> None:
    array = fresh.zeros((2, 3), np.float32)
    for wrong in (np.zeros((2, 3)), np.zeros((2, 2), np.float32)):
        with pytest.raises(ValueError, match=r"expected \(2, 3\) float32"):
            array.set(wrong)


def test_transfers_are_counted(fresh: Device) -> None:
    array = fresh.zeros(10, np.float32)
    assert (fresh.transfers.uploads, fresh.transfers.downloads) == (0, 0)
    array.set(np.ones(10, np.float32))
    fresh.to_device(np.zeros(3, np.uint8))
    array.get()
    array.get(4)
    array.fill(1)
    assert (fresh.transfers.uploads, fresh.transfers.upload_bytes) == (2, 43)
    assert (fresh.transfers.downloads, fresh.transfers.download_bytes) == (2, 56)


def test_work_on_another_queue_waits_and_is_waited_for(fresh: Device) -> None:
    queue, own = fresh.new_queue(), fresh.queue
    array = fresh.zeros(100_000, np.float32)
    download = Download(array)
    for value in range(5):
        array.fill(value)
        with fresh.enqueue_on(queue):
            assert fresh.queue is queue
            found = download.fetch()
            array.fill(-1)
        assert fresh.queue is own
        fresh.wait_for(queue)
        last = array.get()
        assert np.all(last == -1) and np.all(found() == value)
    assert fresh.transfers.downloads == 10
    with fresh.enqueue_on(queue) as yielded:
        array.fill(7)
        fresh.make_wait(yielded)  # for the 7, not for the 8
        array.fill(8)
    assert yielded is own and np.all(np.isin(array.get(), [7, 8]))
    fresh.wait_for(queue)
    assert np.all(array.get() == 8)
    with pytest.raises(KeyError), fresh.enqueue_on(queue):
        raise KeyError
    with fresh.enqueue_on(own):
        array.fill(3)
    fresh.wait_for(own)
    assert fresh.queue is own and np.all(array.get() == 3)


def test_memory_is_accounted_and_released(fresh: Device) -> None:
    assert fresh.allocated == 0
    first = fresh.empty((256, 4), np.float32)
    second = fresh.zeros(100, np.uint8)
    assert fresh.allocated == 4096 + 100
    del first
    gc.collect()
    assert fresh.allocated == 100
    second.get()
    del second
    gc.collect()
    assert fresh.allocated == 0


def test_launches_keep_their_arrays(fresh: Device, kernels: Path) -> None:
    out = fresh.empty(64, np.float32)
    launch = fresh.launch(
        fresh.kernel("some", "fill", SCALE=1), (64,), None, n=64, value=1, out=out
    )
    del out
    gc.collect()
    assert fresh.allocated == 256
    del launch
    gc.collect()
    assert fresh.allocated == 0


def test_too_large_an_array_is_refused_before_it_is_made(fresh: Device) -> None:
    largest = fresh.handle.max_mem_alloc_size
    with pytest.raises(DeviceError) as caught:
        fresh.empty(largest + 1, np.uint8, "the voxel grid")
    message = str(caught.value)
    assert message.startswith("the voxel grid needs ") and fresh.name in message
    assert "\n" not in message and fresh.allocated == 0
    with pytest.raises(DeviceError, match="the grid needs"):
        fresh.empty((2**22, 2**22, 2**22), np.float32, "the grid")  # beyond 64 bits


def test_what_is_taken_lessens_what_is_left(fresh: Device) -> None:
    fresh.require_memory(1000, "a thing")
    fresh.info = replace(fresh.info, memory=fresh.allocated + 999)
    with pytest.raises(DeviceError, match=r"a thing needs .* left"):
        fresh.require_memory(1000, "a thing")
    fresh.require_memory(999, "a thing")


def builds(caplog: pytest.LogCaptureFixture) -> int:
    """Return how many programs were built, by the log."""
    return sum(record.getMessage().startswith("built ") for record in caplog.records)


def test_siblings_share_memory_and_programs(
    fresh: Device, kernels: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "cl")
    other = fresh.sibling()
    taken = other.empty(100, np.uint8)
    assert fresh.allocated == other.allocated == 100
    del taken
    gc.collect()
    assert fresh.allocated == 0
    # Two at a time build a program once, and others of the same handle take it.
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda own: own.kernel("some", "fill", SCALE=1), (fresh, other)))
    Device(fresh.handle, profile=True).kernel("some", "fill", SCALE=1)
    assert builds(caplog) == 1


def test_failing_allocations_are_user_errors(
    fresh: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*args: object) -> None:
        raise pyopencl.MemoryError("clCreateBuffer failed: MEM_OBJECT_ALLOCATION_FAILURE")

    monkeypatch.setattr(pyopencl, "Buffer", refuse)
    with pytest.raises(DeviceError, match=r"could not allocate .* for the images"):
        fresh.empty(10, np.uint8, "the images")
    assert fresh.allocated == 0


# Programs and launches ---------------------------------------------------------------------------


def test_headers_are_inlined_once_and_lines_keep_their_numbers(
    fresh: Device, kernels: Path
) -> None:
    (kernels / "deep.h").write_text("#define DEEP 4\nconstant int deep_line = __LINE__;\n")
    (kernels / "a.h").write_text('// a comment\n#include "deep.h"\nconstant int a = __LINE__;\n')
    (kernels / "b.h").write_text('#include "deep.h"\nconstant int b = __LINE__;')
    (kernels / "some.cl").write_text(
        '// first\n#include "a.h"\n  #include "b.h" // again deep.h\n\n'
        "__kernel void lines(__global int *out) {\n"
        "    out[0] = DEEP; out[1] = deep_line; out[2] = a; out[3] = b; out[4] = __LINE__;\n}\n"
    )
    source = kernel_source.__wrapped__("some")
    assert "#include" not in source and source.count("#define DEEP") == 1
    out = fresh.empty(5, np.int32)
    fresh.launch(fresh.kernel("some", "lines"), (1,), None, out=out)()
    np.testing.assert_array_equal(out.get(), [4, 2, 3, 2, 6])


def test_compilers_complain_about_the_right_file(fresh: Device, kernels: Path) -> None:
    (kernels / "wrong.h").write_text("\n\nint broken(void) { return nonsense; }\n")
    (kernels / "some.cl").write_text('#include "wrong.h"\n__kernel void k(__global int *o) {}\n')
    with pytest.raises(DeviceError, match=r"nonsense") as caught:
        fresh.kernel("some", "k")
    if fresh.info.kind == "cpu":  # PoCL's compiler is clang; others may say it differently
        assert "wrong.h:3" in str(caught.value)


def test_programs_are_built_once_per_set_of_defines(
    fresh: Device, kernels: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "cl")
    out = {}
    for scale in (1, 1, 2, 0.5, np.float64(0.25), np.float32(0.125)):
        out[float(scale)] = fresh.zeros(3, np.float32)
        kernel = fresh.kernel("some", "fill", SCALE=scale)
        fresh.launch(kernel, (3,), None, n=3, value=4, out=out[float(scale)])()
    assert builds(caplog) == 5
    for scale, array in out.items():
        np.testing.assert_array_equal(array.get(), np.full(3, 4 * scale))


@pytest.mark.parametrize(
    ("wanted", "local", "padded"),
    [((37,), (16,), (48, 1)), ((32,), (16,), (32, 1)), ((5, 3), (4, 2), (8, 4))],
)
def test_global_sizes_are_padded(
    fresh: Device, kernels: Path, wanted: tuple, local: tuple, padded: tuple
) -> None:
    out = fresh.zeros(4, np.int32)
    fresh.launch(fresh.kernel("some", "sizes", SCALE=1), wanted, local, out=out)()
    np.testing.assert_array_equal(out.get(), [*padded, *local, *[1] * (2 - len(local))])


# Timings -----------------------------------------------------------------------------------------


def test_profiles_name_every_command(device: Device, kernels: Path) -> None:
    profiled = Device(device.handle, profile=True)
    assert profiled.profiler is not None
    out = profiled.empty(1000, np.float32)
    kernel = profiled.kernel("some", "fill", SCALE=1)
    plain, named = (
        profiled.launch(kernel, (1000,), None, n=1000, value=1, out=out) for _ in range(2)
    )
    named.name = "paint"
    plain()
    plain()
    named()
    out.set(np.zeros(1000, np.float32))
    out.get()
    out.fill(3)
    times = profiled.profiler.collect()
    assert {name: len(ms) for name, ms in times.items()} == {
        "fill": 3,  # twice the kernel of that name, once the array's
        "paint": 1,
        "upload": 1,
        "download": 1,
    }
    assert all(ms >= 0 for each in times.values() for ms in each)
    out.get()
    table = profiled.profiler.table()
    totals = [total for *_, total in table]
    assert totals == sorted(totals, reverse=True)
    row = next(row for row in table if row[0] == "download")
    downloads = profiled.profiler.collect()["download"]
    assert row[1] == 2 and row[2] == pytest.approx(np.median(downloads))
    assert row[3] == pytest.approx(sum(downloads))
    profiled.profiler.clear()
    assert profiled.profiler.collect() == {}


def test_uploads_arrive_in_order_and_only_when_asked_for(device: Device) -> None:
    target = device.zeros((3, 5), np.uint8)
    uploads = Uploads(device, target)
    hosts = [np.full((3, 5), value, np.uint8) for value in range(1, 6)]
    uploads.start(hosts[0])
    assert not target.get().any()
    for before, after in itertools.pairwise(hosts):
        uploads.finish()
        uploads.start(after)
        np.testing.assert_array_equal(target.get(), before)


def test_small_uploads_leave_the_rest_and_downloads_the_one_before(device: Device) -> None:
    array = device.zeros((2, 3), np.float32)
    upload, download = Upload(array), Download(array)
    expected, before = np.zeros(6, np.float32), download.fetch()
    for value, n in ((1, 6), (2, 2), (3, 1), (4, 4)):
        counted = device.transfers.upload_bytes
        upload.room()[:n] = value
        upload.start(n)
        assert device.transfers.upload_bytes == counted + 4 * n
        now = download.fetch()
        np.testing.assert_array_equal(before(), expected.reshape(2, 3))
        expected[:n], before = value, now
    np.testing.assert_array_equal(before(), expected.reshape(2, 3))


def test_packs_cover_particles(device: Device) -> None:
    defines = pack_defines(device, 64)
    assert (defines["PACK"] == 1) == device.is_gpu and defines["PACK"] in (1, 8, 16)
    assert defines["GROUP"] == (64 if device.is_gpu else 1)
    gpu = device if device.is_gpu else other_kind(device)
    most = gpu.handle.max_work_group_size
    assert pack_defines(gpu, 2 * most)["GROUP"] == most
    for n in (1, 16, 17, 100):
        (size,) = pack_size(n, defines)
        packs = size // defines["GROUP"]
        assert size % defines["GROUP"] == 0
        assert packs * defines["PACK"] >= n > (packs - 1) * defines["PACK"]
    assert pixel_pack(device, 8) == 1


@pytest.mark.parametrize("kind", ["own", "other"])
def test_what_is_written_ahead_is_read_when_shown(device: Device, kind: str) -> None:
    device = device if kind == "own" else other_kind(device)
    shapes = [((3, 5), np.uint8), ((1,), np.uint8), ((7, 4), np.float32)]
    ahead = Ahead(device, shapes, "a test")
    hosts = [np.full(shape, 3 + i, dtype) for i, (shape, dtype) in enumerate(shapes)]
    for array, host in zip(ahead.written, hosts, strict=True):
        assert not array.get().any()
        array.set(host)
    if device.is_gpu:
        assert not any(array.get().any() for array in ahead.read)
    ahead.show()
    for array, host in zip(ahead.read, hosts, strict=True):
        np.testing.assert_array_equal(array.get(), host)
