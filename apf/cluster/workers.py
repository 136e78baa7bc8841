"""Workers: which device and which cores each has, and how a worker process is set up."""

from __future__ import annotations

import ctypes
import os
import signal
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from apf.cluster.config import WorkerConfig
from cl import Device, NumpyDevice, list_devices, select_device
from psfs.common.ranges import check_number
from psfs.footage.memory import FRAME_MEMORY

#: Of one machine.
MOST_WORKERS = 1000
#: Environment of a worker: the device it computes on, as `--device` names it, and its cores, `0,1`.
DEVICE, CORES = "APF_DEVICE", "APF_CORES"
#: How many threads OpenCV and its decoder start: one for each core of the machine by themselves,
#: which cost 22 s of 32 cores where one costs 6, in the same time. Views are decoded side by side.
_OPENCV = ("OPENCV_FOR_THREADS_NUM", "OPENCV_FFMPEG_THREADS")
#: Of glibc's malloc.h; and more than a take allocates in one piece.
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _KEPT_BYTES = -1, -3, 2**28


@dataclass(frozen=True)
class Share:
    """What one worker of this machine has. device: as `--device` names it. cores: numbers of the
    CPU cores that it is pinned to; none where a GPU computes, whose host threads mostly wait."""

    device: str
    cores: tuple[int, ...] = ()

    @property
    def environment(self) -> dict[str, str]:
        """What its process is started with."""
        own = {DEVICE: self.device, CORES: ",".join(map(str, self.cores))}
        return own | dict.fromkeys(_OPENCV, "1")


def shares_of_machine(
    device: str = "auto", n_workers: int | None = None, config: WorkerConfig | None = None
) -> list[Share]:
    """Return a share of this machine for each worker; `device` as of `select_device`.

    `auto` and `gpu` deal the GPUs out in turn, the others the cores, in groups that differ by one
    at most. Raises InputError for a number of workers that makes no sense, DeviceError where there
    is no such device.
    """
    config = config or WorkerConfig()
    if n_workers is not None:
        check_number("--workers", n_workers, 1, MOST_WORKERS)
    chosen = select_device(device)  # in a process that starts no worker by forking
    if not isinstance(chosen, NumpyDevice) and chosen.is_gpu:
        names = [device]
        if device in ("auto", "gpu"):
            n_gpus = sum(info.kind == "gpu" for info in list_devices())
            names = [f"gpu:{number}" for number in range(n_gpus)]
        room = int(len(own_cores()) / config.beside_gpu / len(names))
        n_workers = n_workers or min(config.per_gpu, max(1, room)) * len(names)
        return [Share(names[k % len(names)]) for k in range(n_workers)]
    cores = own_cores()
    n_workers = n_workers or max(1, len(cores) // config.cores)
    groups = [tuple(cores[k::n_workers]) for k in range(n_workers)]
    # More workers than cores, which somebody asked for, share them all.
    return [Share(device, group or tuple(cores)) for group in groups]


def own_cores() -> list[int]:
    """Return the numbers of the cores that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def set_up(ignore_interrupts: bool) -> None:
    """Set up this worker process before its first take: pinned to its cores, with a PoCL thread for
    each of them. Without cores of its own it keeps those that it was started on."""
    stated = [int(core) for core in os.environ.get(CORES, "").split(",") if core]
    if stated and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, stated)
    threads = str(len(stated or own_cores()))  # PoCL counts the machine's cores, not the process's
    for name in ("POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT"):  # before and from PoCL 4 on
        os.environ.setdefault(name, threads)
    keep_memory()
    if ignore_interrupts:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def keep_memory() -> None:
    """Have memory that pictures leave kept for the next ones; small ones' where there is glibc.

    Dask's workers give it back at once (`MALLOC_TRIM_THRESHOLD_`), and the kernel clears the pages
    of every picture anew: in the look at 120 frames of 8 cameras and 10 tracked ones 1.3 million
    page faults and 3.2 s of a core, kept 0.06 million and 0.6 s.
    """
    FRAME_MEMORY.keep = True
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if os.name == "posix" else None
    if mallopt is not None:
        mallopt(_MMAP_THRESHOLD, _KEPT_BYTES)
        mallopt(_TRIM_THRESHOLD, _KEPT_BYTES)


def worker_device(asked: str) -> Device | NumpyDevice:
    """Return the device of a task, the worker's own where it states one, with a queue for this
    task; context and programs are kept from task to task."""
    device = _kept_device(os.environ.get(DEVICE) or asked)
    return device.sibling() if isinstance(device, Device) else device


@lru_cache
def _kept_device(choice: str) -> Device | NumpyDevice:
    return select_device(choice)


def setup_plugin(embedded: bool) -> Any:
    """Return the Dask plugin that runs `set_up` in every worker, also in those that join later.
    embedded: the workers are this command's, to which interrupts at the terminal go too."""
    from distributed import WorkerPlugin

    class TakeWorker(WorkerPlugin):
        name = "apf-take-worker"

        def setup(self, worker: Any) -> None:
            set_up(ignore_interrupts=embedded)

    return TakeWorker()
