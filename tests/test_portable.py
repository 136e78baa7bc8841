"""What only POSIX has is behind `psfs.common.system`: everything else imports without it."""

import subprocess
import sys
import types
from pathlib import Path
from typing import Any

import pytest
from helpers.commands import run_python

from psfs.common import system

ROOT = Path(__file__).parents[1]
#: Libraries whose own halves for POSIX are imported before its names are taken away.
LIBRARIES = (
    *("cv2", "scipy.optimize", "matplotlib.figure", "psutil", "pyopencl", "trimesh", "asyncio"),
    *("multiprocessing.util", "concurrent.futures.process", "subprocess", "rich.console"),
    *("platformdirs", "pydantic", "tempfile", "skimage.measure"),
)
#: Run in a process of its own: as Python is on Windows, as far as names go.
WITHOUT_POSIX = f"""
import importlib, os, pkgutil, signal, sys
for name in {LIBRARIES!r}:
    importlib.import_module(name)
for name in ("fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "syslog"):
    sys.modules[name] = None
for name in ("getuid", "geteuid", "getgid", "getpgid", "killpg", "setsid", "fork", "sysconf",
             "uname", "sched_getaffinity", "sched_setaffinity", "mkfifo", "statvfs", "getloadavg"):
    delattr(os, name)
for name in [name for name in dir(signal) if name.startswith("SIG") and name.isupper()]:
    if name not in ("SIGINT", "SIGTERM", "SIGABRT", "SIGSEGV", "SIG_DFL", "SIG_IGN"):
        delattr(signal, name)
imported = 0
for package in map(importlib.import_module, ("cl", "psfs", "apf")):
    for found in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if not found.name.endswith("__main__"):
            importlib.import_module(found.name)
            imported += 1
import apf.cli, apf.cli.commands, psfs.cli, psfs.cli.commands
for main, commands in ((psfs.cli.main, psfs.cli.commands), (apf.cli.main, apf.cli.commands)):
    assert main(["--help"]) == 0 and main(["--version"]) == 0
    for command in commands.COMMANDS:
        assert main([command.name, "--help"]) == 0, command.name
assert psfs.cli.main(["info", "NOWHERE"]) == 2
print("imported", imported)
"""


def test_everything_imports_and_helps_without_what_posix_has() -> None:
    run = run_python("-c", WITHOUT_POSIX)
    assert run.code == 0, run.err
    assert int(run.out.split()[-1]) > 300
    assert run.err.splitlines()[-1].startswith("psfs: error: NOWHERE: no such folder")


def test_a_lock_is_held_until_the_file_closes(tmp_path: Path) -> None:
    path = tmp_path / "locked"
    code = (
        "import sys; from psfs.common.system import lock_file; file = open(sys.argv[1], 'ab')\n"
        "try: lock_file(file)\nexcept BlockingIOError: print('locked')\nelse: print('free')"
    )
    with path.open("ab") as file:
        system.lock_file(file)
        assert run_python("-c", code, path).out.strip() == "locked"
    assert run_python("-c", code, path).out.strip() == "free"


def test_windows_locks_a_byte_that_nobody_reads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[tuple[int, ...]] = []
    taken = False

    def locking(file: int, mode: int, count: int) -> None:
        if taken:
            raise PermissionError(13, "Permission denied")
        calls.append((mode, count, stream.tell()))

    windows: Any = types.SimpleNamespace(locking=locking, LK_NBLCK=2)
    monkeypatch.setitem(sys.modules, "msvcrt", windows)
    monkeypatch.setitem(sys.modules, "fcntl", None)
    path = tmp_path / "locked"
    path.write_bytes(b"a manifest")
    with path.open("r+b") as stream:
        stream.seek(3)
        system.lock_file(stream)
        assert stream.tell() == 3 and stream.read() == b"anifest"
        ((mode, count, at),) = calls
        assert (mode, count) == (2, 1) and at > path.stat().st_size
        taken = True
        with pytest.raises(BlockingIOError):
            system.lock_file(stream)


def test_processes_cores_and_memory_are_known(monkeypatch: pytest.MonkeyPatch) -> None:
    import os

    import psutil

    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    assert system.is_alive(os.getpid()) and not system.is_alive(ended.pid)
    assert not system.is_alive(2**70)
    assert system.physical_memory() > 2**28
    before = system.list_own_cores()
    system.pin_to_cores(before[:1])
    try:
        assert system.list_own_cores() == before[:1]
    finally:
        system.pin_to_cores(before)
    monkeypatch.delattr(psutil.Process, "cpu_affinity")  # as on macOS
    system.pin_to_cores([0])
    assert system.list_own_cores() == list(range(os.cpu_count() or 1))
