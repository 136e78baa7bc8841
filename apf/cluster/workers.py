"""The device and cores of each worker, and the setup of a worker process."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import lru_cache

from apf.cluster import CORES_BESIDE_GPU, PER_GPU
from cl import Device, NumpyDevice, list_devices, select_device
from psfs.common.ranges import check_number
from psfs.common.system import KEPT_BYTES, keep_freed_memory, list_own_cores, pin_to_cores

#: Most workers of one machine.
MOST_WORKERS = 1000
#: Environment variables of a worker: its device, as `--device` names it, and its cores, `0,1`.
DEVICE, CORES = "APF_DEVICE", "APF_CORES"
#: Environment variables for the number of threads of OpenCV and its decoder. Their default, one per
#: core of the machine, costs 22 s of 32 cores where one thread costs 6 s and takes as long; views
#: are decoded in parallel anyway.
_OPENCV = ("OPENCV_FOR_THREADS_NUM", "OPENCV_FFMPEG_THREADS")


@dataclass(frozen=True)
class Share:
    """The share of this machine that one worker gets.

    device: as `--device` names it. cores: CPU cores that it is pinned to; empty if a GPU computes,
    whose host threads mostly wait.
    """

    device: str
    cores: tuple[int, ...] = ()

    @property
    def environment(self) -> dict[str, str]:
        """Environment variables that its process is started with."""
        values = {DEVICE: self.device, CORES: ",".join(map(str, self.cores))}
        return values | dict.fromkeys(_OPENCV, "1")


def share_machine(device: str = "auto", n_workers: int | None = None) -> list[Share]:
    """Return a share of this machine for each worker; device: as for `select_device`.

    `auto` and `gpu` distribute the GPUs in turn; other devices distribute the cores in groups that
    differ by one at most. Raises InputError for an implausible number of workers, DeviceError if
    there is no such device.
    """
    if n_workers is not None:
        check_number("--workers", n_workers, 1, MOST_WORKERS)
    chosen = select_device(device)  # in a process that starts no worker by forking
    if not isinstance(chosen, NumpyDevice) and chosen.is_gpu:
        names = [device]
        if device in ("auto", "gpu"):
            n_gpus = sum(info.kind == "gpu" for info in list_devices())
            names = [f"gpu:{number}" for number in range(n_gpus)]
        room = len(list_own_cores()) // (CORES_BESIDE_GPU * len(names))
        n_workers = n_workers or min(PER_GPU, max(1, room)) * len(names)
        return [Share(names[k % len(names)]) for k in range(n_workers)]
    cores = list_own_cores()
    n_workers = n_workers or len(cores)
    groups = [tuple(cores[k::n_workers]) for k in range(n_workers)]
    # If the user asked for more workers than cores, all share the cores.
    return [Share(device, group or tuple(cores)) for group in groups]


def set_up_worker() -> None:
    """Set up this worker process before its first take.

    Pins it to its cores, with a PoCL thread for each; without cores of its own it keeps those that
    it was started on.
    """
    stated = [int(core) for core in os.environ.get(CORES, "").split(",") if core]
    if stated:
        pin_to_cores(stated)
    threads = str(len(stated or list_own_cores()))  # PoCL counts the machine's, not the process's
    for name in ("POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT"):  # before PoCL 4, and since
        os.environ.setdefault(name, threads)
    # Dask's workers return freed memory at once (`MALLOC_TRIM_THRESHOLD_`), and the kernel then
    # clears the pages of every picture again. Diagnosing 120 frames of 8 cameras and tracking 10 of
    # them took 1.3 million page faults and 3.2 s of a core, with kept memory 0.06 million and 0.6.
    keep_freed_memory(KEPT_BYTES)


def select_worker_device(asked: str) -> Device | NumpyDevice:
    """Return the device of a task: the worker's own, if stated, else `asked`.

    Every task gets a queue of its own; context and programs are kept.
    """
    device = _cached_device(os.environ.get(DEVICE) or asked)
    return device.sibling() if isinstance(device, Device) else device


_cached_device = lru_cache(select_device)
