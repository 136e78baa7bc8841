"""`compare_timings.py batch`: takes per minute by workers, and where a take's time goes.

Takes are filmed first, then done by the very tasks of `apf batch` on clusters of this machine:
workers on one GPU, on two, or on shares of the CPU's cores. Starting a cluster is no part of it,
nor is compiling, which is done once before and kept on disk by the drivers. `--start found` looks
for the person in every take, as users do; by default the true first pose is given, so that it is
tracking that is timed.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from apf.cli.batch.take import TakeDone, TakeJob, do_take
from apf.cluster.connection import embedded_cluster
from apf.cluster.pool import Pool, Task
from apf.cluster.workers import Share, own_cores, shares_of_machine
from apf.synthetic.generate import generate
from apf.synthetic.scene import SceneConfig
from cl import Device, InputError
from psfs.cli.commandline import add_command
from psfs.sequence import Sequence as Footage
from timings.measure import places
from timings.results import Results, add_timing_flags
from timings.tables.batch import print_report

#: Takes at once on a GPU; of two GPUs the last two numbers, on each.
_AT_ONCE = (1, 2, 4, 8)
#: Takes for each worker, so that they fall out of step and the last one weighs little.
_PER_WORKER = 3
#: The takes: cameras, frames, size; and with --quick.
_SCENE = {"cameras": 8, "frames": 120, "size": (640, 480), "fps": 60.0}
_QUICK = {"cameras": 3, "frames": 8, "size": (160, 120), "fps": 60.0}
_QUICK_FLAGS = ("--particles=40", "--layers=3", "--voxel-size=0.05")
_DISTINCT = 2  # takes that are filmed; the same are done again under other names


def register(commands: argparse._SubParsersAction) -> None:
    parser = add_command(commands, "batch", run, help="takes per minute by workers")
    add_timing_flags(parser)
    parser.add_argument(
        "--start", choices=("true", "found"), default="true", help="given, or found in every take"
    )
    parser.add_argument(
        "--at-once", type=int, nargs="+", default=_AT_ONCE, metavar="N", help="takes on each GPU"
    )
    parser.add_argument("--lean", action="store_true", help="without overlay and report")


def run(args: argparse.Namespace) -> None:
    scene = _QUICK if args.quick else _SCENE
    start, lean = args.start, args.lean
    results = Results.begin("batch", args, {"scene": scene, "start": start, "lean": lean})
    with tempfile.TemporaryDirectory(prefix="apf-batch-") as folder:
        takes = _filmed(Path(folder) / "takes", scene)
        results.plan("decoding", partial(decoding, takes[0]))
        flags = (*(_QUICK_FLAGS if args.quick else ()), "--all-cameras")
        flags += ("--no-overlay", "--no-report") if lean else ()
        measured = clusters(args.quick, args.at_once)
        first = next(iter(measured.values()))
        compiled = Path(folder) / "compiled"
        once = partial(throughput, first[: len(takes)], takes, compiled, flags, True, 1)
        results.plan("compiling", once)
        # The largest first: should the time end, what is left out is what tells least.
        for label, shares in reversed(measured.items()):
            out = Path(folder) / label.replace(" ", "_").replace(",", "")
            measure = partial(throughput, shares, takes, out, flags, start == "true")
            results.plan(f"workers {label}", measure)
        results.measure()
    print_report(results)


def clusters(quick: bool, at_once: Sequence[int] = _AT_ONCE) -> dict[str, list[Share]]:
    """The workers of every cluster that is measured, by its label. at_once: takes on a GPU."""
    n_gpus = sum(place.cores is None for place in places())
    if n_gpus:
        found = {f"1 GPU, {n} at once": shares_of_machine("gpu:0", n) for n in at_once}
        if n_gpus > 1:
            found |= {f"2 GPUs, {2 * n} at once": shares_of_machine("gpu", 2 * n)
                      for n in at_once[-2:]}  # fmt: skip
        return found
    cores = own_cores()
    found = {}
    n = 1
    while n <= len(cores):
        groups = [tuple(cores[k::n]) for k in range(n)]
        found[f"{n} of {len(groups[0])} cores"] = [Share("cpu", group) for group in groups]
        n *= 2
    # What pinning is for: as many workers, each with all cores.
    found[f"{len(cores)} not pinned"] = [Share("cpu", tuple(cores))] * len(cores)
    return dict(list(found.items())[-2:]) if quick else found


def _filmed(folder: Path, scene: dict[str, Any]) -> list[Path]:
    device = Device.best()
    takes = [folder / f"walk{seed}" for seed in range(_DISTINCT)]
    for seed, take in enumerate(takes):
        generate(take, SceneConfig(seed=seed, **scene), device)
    return takes


def decoding(take: Path) -> dict[str, float]:
    """ms per frame of reading all cameras, and of the host's processor doing it."""
    sequence = Footage.open(take)
    began, worked = time.perf_counter(), time.process_time()
    n = sum(1 for _ in sequence.frames(slice(None)))
    wall, processor = time.perf_counter() - began, time.process_time() - worked
    return {"frames": n, "ms": 1e3 * wall / n, "core_ms": 1e3 * processor / n}


def throughput(
    shares: Sequence[Share], takes: Sequence[Path], out: Path, flags: Sequence[str], given: bool,
    per_worker: int = _PER_WORKER,
) -> dict[str, Any]:  # fmt: skip
    """Takes per minute of workers with these shares, after a short take on each if they do
    several; s that a take spends in each stage, and s of a core that it costs."""

    def job(name: str, number: int, *more: str) -> Task:
        take = takes[number % len(takes)]
        init = (f"--init={take / 'truth.npz'}",) * (given or bool(more))
        words = (*flags, *init, *more)
        return Task(name, do_take, (TakeJob(name, take, out / name, out / "log", words),))

    n_takes = max(len(takes), per_worker * len(shares))
    n_short = len(shares) if per_worker > 1 else 0
    with embedded_cluster(shares) as client:
        _all(Pool(client), [job(f"warm{k}", k, "--frames=0:3") for k in range(n_short)])
        began = time.perf_counter()
        done = _all(Pool(client), [job(f"take{k}", k) for k in range(n_takes)])
        seconds = time.perf_counter() - began
    frames = sum(row["frames"] for one in done for row in one.rows)
    return {
        "workers": len(shares),
        "gpus": len({share.device for share in shares if not share.cores}),
        "takes": n_takes,
        "seconds": seconds,
        "per_minute": 60 * n_takes / seconds,
        "frames_per_s": frames / seconds,
        "stages": _means([one.seconds for one in done]),
        "core_stages": (core_stages := _means([one.core_seconds for one in done])),
        "core_s": sum(core_stages.values()),
    }


def _means(of_takes: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """The mean of every stage."""
    sums: Counter[str] = Counter()
    for stages in of_takes:
        sums.update(stages)
    return {stage: total / len(of_takes) for stage, total in sums.items()}


def _all(pool: Pool, tasks: Sequence[Task]) -> list[TakeDone]:
    found = []
    for task, outcome in pool.outcomes(tasks):
        if not isinstance(outcome, TakeDone):
            raise InputError(f"{task.name}: {outcome}")
        found.append(outcome)
    return found
