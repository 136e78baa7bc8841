"""Fixtures that many tests share: every OpenCL device, a small walk, a stored run; and that tests
launch the kernels that they are marked for."""

import gc
import os
import shutil
import signal
from collections.abc import Generator
from pathlib import Path

# Before NumPy is imported, for this process and its children: the matrices here are small, and
# OpenBLAS's waiting threads took four fifths of the twins' time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Likewise of OpenCV and its decoder: the processes of pytest-xdist have the cores busy.
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")
os.environ.setdefault("OPENCV_FFMPEG_THREADS", "1")
# Readline sets these in the processes that pytest-xdist starts; commands would cut tables to them.
os.environ.pop("COLUMNS", None)
os.environ.pop("LINES", None)
# Else every command that a test starts compiles the packages again, for half a second.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

import numpy as np
import pytest
from helpers import examined, faults, parity
from helpers.commands import succeed

from apf.body.toml import save_body
from apf.formats.pose import write_pose
from apf.initialisation.start import StartConfig
from apf.synthetic.generate import generate
from apf.synthetic.scene import SceneConfig
from apf.takes.start import read_given_start
from cl import Device
from cl.listing import working_devices

#: Two drivers may give a processor the same name.
DEVICES = {f"{number}-{d.name.strip()}": d for number, d in enumerate(working_devices())}


@pytest.fixture(autouse=True)
def _own_modules_again() -> Generator[None, None, None]:
    """Take back what a program, run in this process, forbids to the processes that it starts."""
    yield
    os.environ.pop("PYTHONSAFEPATH", None)


@pytest.fixture(scope="session", autouse=True)
def _programs_are_kept() -> Generator[None, None, None]:
    """Keep what tests build: devices share programs as long as one of them lives."""
    kept = [Device(handle) for handle in DEVICES.values()]
    yield
    kept.clear()


@pytest.fixture(scope="session", params=DEVICES)
def device(request: pytest.FixtureRequest) -> Device:
    """Each OpenCL device of this machine that works, in turn."""
    return Device(DEVICES[request.param])


@pytest.fixture(scope="session")
def small_walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a synthetic walk, to read alone: 4 cameras, 4 frames."""
    folder = tmp_path_factory.mktemp("made") / "walk"
    config = SceneConfig(cameras=4, frames=4, fps=60, size=(160, 120), seed=4)
    generate(folder, config, Device.best())
    return folder


@pytest.fixture(scope="module")
def walk(small_walk: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of `small_walk`, to change."""
    return Path(shutil.copytree(small_walk, tmp_path_factory.mktemp("walk") / "walk"))


@pytest.fixture(scope="session")
def fitted(small_walk: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the body and the first pose of `small_walk`, fitted once for all tests."""
    found = read_given_start(small_walk, 0, None, small_walk / "truth.npz", "y-up")
    assert found is not None
    folder = tmp_path_factory.mktemp("fitted")
    save_body(folder / "body.toml", found[0])
    write_pose(folder / "start.txt", found[1], found[0])
    return folder


@pytest.fixture(scope="session")
def made_out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A stored run within its sequence's folder, for `out` to copy."""
    folder = faults.masks_folder(tmp_path_factory.mktemp("made") / "masks")
    out = folder / "out"
    succeed("psfs", "reconstruct", str(folder), "-o", str(out), "--voxel-size", "0.04")
    return out


@pytest.fixture(scope="module")
def out(made_out: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of three frames of five cameras, of which the first shows nobody."""
    folder = Path(shutil.copytree(made_out.parent, tmp_path_factory.mktemp("walk") / "masks"))
    summary = folder / "out" / "summary.json"  # which names the sequence in full
    summary.write_text(summary.read_text().replace(str(made_out.parent), str(folder)))
    return folder / "out"


@pytest.fixture(scope="session", autouse=True)
def _quick_preview() -> Generator[None, None, None]:
    """Runs have a black picture in place of six shaded views, which take a second; test_commands.py
    has the views."""
    picture = np.zeros((4, 6, 3), np.uint8)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("psfs.cli.reconstruct.draw_preview", lambda *_: picture)
        yield


@pytest.fixture(scope="session", autouse=True)
def _examined_once() -> Generator[None, None, None]:
    """The same footage is examined once, and the body fitted to the same joints once."""
    with examined.remembered():
        yield


@pytest.fixture
def quick_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """An automatic start with a small search, where any start will do: 2 s instead of 8."""
    small = StartConfig(n_frames=4, n_searched=1, n_headings=4)
    monkeypatch.setattr("apf.initialisation.sequence.StartConfig", lambda: small)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--without-kernels",
        action="store_true",
        help="run parity tests again without each of their kernels: they must fail (with -n 0)",
    )


def pytest_configure(config: pytest.Config) -> None:
    # A shell has what runs in its background ignore Ctrl-C, which tests send.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    config.addinivalue_line(
        "markers", "parity(*kernels): compares each kernel, 'stage.name', with its twin"
    )


#: Whether some marked test noticed that the kernel was left out.
NOTICED: dict[str, bool] = {}


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, None, None]:
    """Modules and tests stay: searches for garbage among them found nothing in 5 s of each worker,
    and need not look at them again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    wanted = {name for mark in item.iter_markers("parity") for name in mark.args}
    if not wanted:
        return (yield)
    with parity.launched() as names:
        yield
    assert wanted <= names, f"marked for {sorted(wanted - names)}, which it does not launch"
    if item.config.getoption("--without-kernels"):
        for kernel in sorted(wanted):
            NOTICED[kernel] = NOTICED.get(kernel, False) or fails_without(kernel, item)


def fails_without(kernel: str, item: pytest.Item) -> bool:
    """Does the test fail where the kernel is not run?"""
    try:
        with parity.left_out(kernel):
            item.runtest()
    except Exception:
        return True
    return False


def pytest_sessionfinish(session: pytest.Session) -> None:
    if NOTICED:
        print(f"\n{sum(NOTICED.values())} of {len(NOTICED)} kernels were missed when left out")
    unnoticed = sorted(kernel for kernel, noticed in NOTICED.items() if not noticed)
    if unnoticed:
        print(f"\nno parity test fails without {', '.join(unnoticed)}")
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
