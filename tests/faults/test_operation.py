"""Faults while a command works: full disks, lost devices, hanging decoders, signals."""

import errno
import importlib
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from multiprocessing.pool import AsyncResult
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl
import pytest
from helpers import faults
from helpers.commands import run, run_python, succeed
from helpers.faults import BOX

import apf.tracking.pipeline as pipeline
import cl.launch
import psfs.cli
from apf.tracking.track import PARTS, Track
from cl import pocl_wheel
from cl.listing import device_info, working_devices
from psfs.cli.program import DONE, INTERRUPTED, exit_code
from psfs.common.outputs import find_unfinished_command
from psfs.voxels.clouds import read_cloud

pytestmark = pytest.mark.skipif(os.name != "posix", reason="sends signals and limits files")


def reconstruct(stock: Path, *more: str) -> list[str]:
    return ["psfs", "reconstruct", str(stock / "seq"), "-o", str(stock / "new"), *BOX, *more]


def track(stock: Path, *more: str) -> list[str]:
    return ["apf", "track", str(stock / "seq"), "-o", str(stock / "new"), *BOX, "--no-overlay",
            "--no-report", "--init", str(stock / "pose.txt"), "--particles", "40", "--layers", "2",
            *more]  # fmt: skip


def readable(out: Path) -> None:
    """Assert that all visible files can be read, and no temporary one is left."""
    for path in out.rglob("*"):
        assert not path.name.startswith(".psfs-"), path
        if path.suffix == ".npz" and path.parent.name == "clouds":
            read_cloud(path)
        elif path.suffix == ".npz":
            Track.open(path)
        elif path.suffix == ".json":
            json.loads(path.read_text())


def test_a_full_disk(stock: Path) -> None:
    """By the limit of a file's size, as a disk's quota does."""
    code = (
        "import resource, signal, sys; signal.signal(signal.SIGXFSZ, signal.SIG_IGN);"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (900, 900));"
        "from psfs.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    # What is compiled here would be cut to 900 bytes, for all other tests to fail over.
    words = [*reconstruct(stock)[1:], "--device", "numpy"]
    done = run_python("-c", code, *words, PYTHONDONTWRITEBYTECODE="1")
    assert done.code == 2 and "File too large" in done.err, done
    assert "Traceback" not in done.err
    readable(stock / "new")
    assert find_unfinished_command(stock / "new") is not None
    succeed(*reconstruct(stock, "--device", "numpy"))
    assert find_unfinished_command(stock / "new") is None


@pytest.mark.parametrize("command", [reconstruct, track])
def test_a_device_that_is_lost(
    stock: Path, monkeypatch: pytest.MonkeyPatch, command: Callable[..., list[str]]
) -> None:
    # The way back begins when all frames are there.
    words = command(stock) + (["--one-way"] if command is track else [])
    written = PARTS if command is track else "clouds/frame*.npz"
    real = pyopencl.enqueue_nd_range_kernel

    def lost(*arguments: Any, **more: Any) -> Any:
        if len(list((stock / "new").glob(written))) == 2:
            raise pyopencl.RuntimeError("clEnqueueNDRangeKernel failed: DEVICE_NOT_AVAILABLE")
        return real(*arguments, **more)

    monkeypatch.setattr(pyopencl, "enqueue_nd_range_kernel", lost)
    # The driver's own call fails, too, whereupon pyopencl's says why.
    monkeypatch.setattr(cl.launch, "_ENQUEUE", lambda *_: -2)
    monkeypatch.setattr(pipeline, "PART_SECONDS", 0.0)
    outcome = run(*words)
    last = outcome.err.strip().splitlines()[-1]
    assert outcome.code == 2 and "DEVICE_NOT_AVAILABLE" in last, outcome
    assert "2 of 3 frames are in" in last and "Traceback" not in outcome.err
    readable(stock / "new")
    assert find_unfinished_command(stock / "new") is not None
    if command is track:
        assert len(Track.open(stock / "new")) == 2


def test_a_decoder_that_hangs(stock: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import psfs.footage.media as media

    hanging, released = threading.Event(), threading.Event()
    read, wait = media.ImagesDecoder.read, AsyncResult.wait

    def hangs(self: Any, index: int, *into: Any) -> np.ndarray:
        if index == 2:
            hanging.set()
            released.wait(120)
        return read(self, index, *into)

    def wait_until_one_hangs(call: Any, _: float) -> None:
        """Whose time is over then, however slow the machine is."""
        while not hanging.is_set() and not call.ready():
            wait(call, 0.02)

    monkeypatch.setattr(media.ImagesDecoder, "read", hangs)
    monkeypatch.setattr(AsyncResult, "wait", wait_until_one_hangs)
    outcome = run(*reconstruct(stock, "--frames", "1:", "--device", "numpy"))
    released.set()
    last = outcome.err.strip().splitlines()[-1]
    assert outcome.code == 2 and "frame 2 was not decoded" in last and "seq/masks" in last


def test_parts_of_a_track_that_was_killed(stock: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each second's frames are there; the parts go when the whole is written."""
    monkeypatch.setattr(pipeline, "PART_SECONDS", 0.0)
    assert run(*track(stock, "--seed", "3")).code == 0
    whole = Track.open(stock / "new")
    assert not list((stock / "new").glob(PARTS)) and len(whole) == 3
    import apf.takes.track as module

    def killed(*_: Any) -> None:
        raise SystemError("killed")

    monkeypatch.setattr(module, "write_tracks", killed)
    outcome = run(*track(stock, "--seed", "3"))
    assert outcome.code == 70
    found = Track.open(stock / "new")
    np.testing.assert_array_equal(found.poses, whole.poses)
    np.testing.assert_array_equal(found.covariance, whole.covariance)
    assert find_unfinished_command(stock / "new") is not None


@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT", "SIGHUP"])
def test_signals(stock: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is done is kept, in one line, with exit code 130."""
    import psfs.cli.reconstruct as module

    if signal.getsignal(getattr(signal, name)) is signal.SIG_IGN:
        pytest.skip("the tests were started to ignore it, as by nohup")
    write = module.write_cloud

    def signalled(cloud: Any, stem: Path, normals: bool) -> None:
        if stem.name == "frame_000002":
            os.kill(os.getpid(), getattr(signal, name))
            time.sleep(0.5)
        write(cloud, stem, normals)

    monkeypatch.setattr(module, "write_cloud", signalled)
    outcome = run(*reconstruct(stock, "--device", "numpy"))
    assert outcome.code == 130 and outcome.err.strip().splitlines()[-1] == "psfs: interrupted"
    summary = json.loads((stock / "new/summary.json").read_text())
    assert not summary["complete"] and len(summary["frames"]) == 2
    readable(stock / "new")
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    warned = run("psfs", "view", str(stock / "new"), "--png", str(stock / "x.png"))
    assert warned.code == 0 and "did not finish" in warned.err


def test_a_signal_during_an_import(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The module is imported wholly before the work ends: half of SciPy's fails ever after."""
    send = f"import os, time\nos.kill(os.getpid(), {int(signal.SIGTERM)})\ntime.sleep(0.5)\n"
    (tmp_path / "imported_late.py").write_text(f"{send}whole = True")
    monkeypatch.syspath_prepend(tmp_path)
    found = []

    def work() -> None:
        found.append(importlib.import_module("imported_late").whole)
        time.sleep(60)

    assert exit_code("apf", work) == INTERRUPTED and found == [True]


def test_what_is_ignored_stays_so() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        assert exit_code("apf", lambda: os.kill(os.getpid(), signal.SIGHUP)) == DONE
    finally:
        signal.signal(signal.SIGHUP, before)


def test_an_interrupt_on_the_way_back(stock: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All frames are there, but as they were tracked forward: not what a whole run gives."""

    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("apf.tracking.two_way._fuse_window", interrupted)
    outcome = run(*track(stock))
    assert outcome.code == 130 and "3 of 3 frames are in" in outcome.err, outcome
    readable(stock / "new")
    assert find_unfinished_command(stock / "new") is not None
    assert Track.open(stock / "new").interrupted
    monkeypatch.undo()
    assert run(*track(stock)).code == 0 and find_unfinished_command(stock / "new") is None
    assert not Track.open(stock / "new").interrupted


def test_a_camera_with_fewer_frames(stock: Path) -> None:
    (stock / "seq/masks/c3/0002.png").unlink()
    faults.refused(reconstruct(stock), stock, "c3 2", "--frames 0:2")


@pytest.mark.parametrize("name", ["MPLBACKEND", "SOURCE_DATE_EPOCH"])
def test_variables_that_packages_do_not_know(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Matplotlib, or NumPy, would refuse to be imported."""
    monkeypatch.setenv(name, "nonsense")
    monkeypatch.setattr(sys, "argv", ["psfs", "devices"])
    assert psfs.cli.main() == 0
    assert name not in os.environ


def test_no_linker(stock: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cpus = [handle for handle in working_devices() if device_info(handle).kind == "cpu"]
    if not cpus or not all(map(pocl_wheel.is_wheel, cpus)):
        pytest.skip("another CPU device than PoCL's wheel")
    monkeypatch.setattr("cl.pocl_wheel.shutil.which", lambda _: None)
    faults.refused(reconstruct(stock, "--device", "cpu"), stock, "no linker `ld`")


@pytest.mark.parametrize("error", [MemoryError(), OSError(errno.EAGAIN, "no more processes")])
def test_no_memory(stock: Path, monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    def none(*_: Any, **__: Any) -> None:
        raise error

    monkeypatch.setattr("psfs.session.make_reconstructor", none)
    faults.refused(reconstruct(stock), stock, "not enough memory")


def test_another_locale(stock: Path) -> None:
    folder = (stock / "walk").rename(stock / "gehört é")
    other = {name: None for name in os.environ if name.startswith("LC_")}
    other |= {"LANG": "C", "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}
    done = run_python("-m", "psfs.cli", "info", folder, "--no-pictures", **other)
    assert done.code == 0 and "Traceback" not in done.err, done.err
