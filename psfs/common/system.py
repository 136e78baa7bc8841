"""Functions that differ between operating systems: locks, signals, processes, cores and memory. No
other module asks which system it runs on, except the viewer."""

from __future__ import annotations

import ctypes
import os
import platform
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from types import FrameType
from typing import IO, TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

#: Time in which a process or a thread that was stopped ends, with what it writes then, s.
PATIENCE = 60.0
#: Memory for what was computed and may be asked for again, bytes: evidence maps of 218 frames of
#: four VGA cameras, points of 700 frames of 30,000 voxels.
KEPT_BYTES = 2**28
#: Where Windows locks a byte: beyond what is written, since it keeps others from reading it.
_LOCKED_BYTE = 2**30
#: After which an import that a signal met is looked at again, s.
_IMPORT_TIME = 0.05
#: Of glibc's malloc.h.
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3


def lock_file(file: IO[bytes]) -> None:
    """Lock an open file until it closes. Raises BlockingIOError if another process has locked it,
    OSError where the file system has no locks."""
    try:
        import fcntl
    except ImportError:
        _lock_byte(file)
    else:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _lock_byte(file: IO[bytes]) -> None:
    """Lock one byte of a file, as Windows does. Raises BlockingIOError."""
    import msvcrt

    windows: Any = msvcrt  # whose names type checkers know on Windows only
    before = file.tell()
    file.seek(_LOCKED_BYTE)
    try:
        windows.locking(file.fileno(), windows.LK_NBLCK, 1)
    except PermissionError as error:
        raise BlockingIOError(*error.args) from None
    finally:
        file.seek(before)


def is_alive(process: int) -> bool:
    """Return whether a process of this number runs."""
    import psutil

    try:
        return bool(psutil.pid_exists(process))
    except OverflowError:  # of a name that only looks like ours
        return False


def physical_memory() -> int:
    """Return the bytes of this machine's memory."""
    import psutil

    return int(psutil.virtual_memory().total)


def list_own_cores() -> list[int]:
    """Return the numbers of the cores that this process may run on; all where the system does not
    pin processes to cores, as macOS."""
    import psutil

    process = psutil.Process()
    if hasattr(process, "cpu_affinity"):
        return sorted(process.cpu_affinity())
    return list(range(os.cpu_count() or 1))


def pin_to_cores(cores: Sequence[int]) -> None:
    """Let this process run on these cores only, where the system can do that."""
    import psutil

    process = psutil.Process()
    if hasattr(process, "cpu_affinity"):
        process.cpu_affinity(list(cores))


@contextmanager
def handle_signals(handler: Callable[[int, Any], Any], names: Iterable[str]) -> Iterator[None]:
    """Have the signals of these names, as many as the system has, call `handler` inside, but for
    those that this process was started to ignore, as by nohup. In the main thread only."""
    heard = [n for n in _signals(names) if signal.getsignal(n) is not signal.SIG_IGN]
    before = {number: signal.signal(number, handler) for number in heard}
    try:
        yield
    finally:
        for number, usual in before.items():
            signal.signal(number, usual)


def interrupt(number: int, frame: FrameType | None) -> None:
    """Handle a signal: raise KeyboardInterrupt; during an import later, since what is imported by
    half fails when it is imported again for what is still to be written."""
    while frame is not None and not frame.f_code.co_filename.startswith("<frozen importlib"):
        frame = frame.f_back
    if frame is None:
        raise KeyboardInterrupt
    again: Callable[[int], object] = signal.raise_signal
    if hasattr(signal, "pthread_kill"):  # which ends what the main thread waits for
        again = partial(signal.pthread_kill, threading.get_ident())
    later = threading.Timer(_IMPORT_TIME, again, [number])
    later.daemon = True
    later.start()


@contextmanager
def defer_interrupts(names: Sequence[str] = ("SIGINT", "SIGTERM", "SIGHUP")) -> Iterator[None]:
    """Raise KeyboardInterrupt at the end instead of inside, if one of these signals arrives.

    The processes that threads started inside start never receive the first of them, which a
    terminal sends to all processes of a command: their own handlers are set only once they have
    imported their modules. Other threads than the main one receive no signals.
    """
    if threading.current_thread() is not threading.main_thread():
        with _block_signals(names[:1]):
            yield
        return
    came: list[int] = []
    with handle_signals(lambda number, _: came.append(number), names), _block_signals(names[:1]):
        yield
    if came:
        raise KeyboardInterrupt


@contextmanager
def _block_signals(names: Iterable[str]) -> Iterator[None]:
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # which else unblocks them when the first process is started
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _signals(names))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def import_nothing_from_current_folder() -> None:
    """Let no Python that this process starts import files of the current folder, which Python puts
    first: the names of files in a take would stand for modules."""
    os.environ["PYTHONSAFEPATH"] = "1"
    if sys.version_info < (3, 11):  # where the variable is unknown
        from multiprocessing import util

        # A spawned process gets the search path of this one after it has started.
        util._args_from_interpreter_flags = lambda: ["-I"]  # type: ignore[attr-defined]


def ignore_signals(names: Iterable[str]) -> None:
    """Let this process ignore the signals of these names, as many as the system has."""
    for number in _signals(names):
        signal.signal(number, signal.SIG_IGN)


def _signals(names: Iterable[str]) -> list[int]:
    return [getattr(signal, name) for name in names if hasattr(signal, name)]


def keep_freed_memory(nbytes: int) -> None:
    """Let the process keep up to `nbytes` that it frees for its next allocations, where its C
    library is glibc."""
    if sys.platform != "linux":
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_MMAP_THRESHOLD, nbytes)
        mallopt(_TRIM_THRESHOLD, nbytes)


def versions() -> dict[str, str]:
    """Return the versions of this program, of Python and of the libraries that affect results."""
    from importlib import metadata  # takes 20 ms

    packages = ("psfs-apf", "numpy", "pyopencl", "opencv-python-headless", "scipy")
    numbers = {"python": platform.python_version()}
    for package in packages:
        try:
            numbers[package] = metadata.version(package)
        except metadata.PackageNotFoundError:  # another flavour of the same library
            numbers[package] = "unknown"
    return numbers


@contextmanager
def changed_environment(variables: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables inside the `with`, and restore them after it: for processes that
    are started there."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
