"""Uploads ahead of their use, and work-group shapes."""

import itertools

import numpy as np
import pytest
from helpers.kinds import other_kind

from cl import Device
from cl.staging import Ahead, Download, Upload, Uploads
from cl.workgroups import pack_defines, pack_size, pixel_pack


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
