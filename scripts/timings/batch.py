"""`compare_timings.py batch`: takes per minute by workers, and where a take's time goes.

Takes are generated first, then processed by the tasks of `apf batch` on clusters of this machine:
workers on one GPU, on two, or on shares of the CPU's cores. The figures exclude the start of the
cluster, compilation, which is done once before and cached on disk by the drivers, and the first and
the last takes. Takes of one length that begin together would all read their footage at the same
time, with the GPU idle, and then wait for each other's tracking; takes of a lab do not. So workers
begin one after another, and only takes that end while all workers are busy count. With `--start
found`, the person is searched for in every take, as users do; by default the true first pose is
given, so that tracking alone is timed.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

from apf.cli.batch_take import TakeDone, TakeJob, process_take
from apf.cli.commands import COMMANDS
from apf.cluster.processes import Pool, Processes, Task
from apf.cluster.task_side import TaskProgress
from apf.cluster.workers import Share, list_own_cores, share_machine
from apf.request import TrackRequest
from apf.synthetic.generate import generate
from apf.synthetic.scene import SceneConfig
from apf.timings.measure import places
from cl import Device, InputError
from psfs.cli.program import find_stated, program_parser
from psfs.sequence import Sequence as Footage
from timings.grid import Grid, number
from timings.results import Results, add_command, add_timing_flags

#: A take, and the time of each of its stages, s: of the clock, and of the CPU.
TimedTake = tuple[TakeDone, dict[str, float], dict[str, float]]
#: Takes at once on a GPU; with two GPUs the last two numbers, on each.
_AT_ONCE = (1, 2, 4, 8)
#: Counted takes of each worker by default; one with --quick.
_PER_WORKER = 2
#: The takes: cameras, frames, size; and with --quick.
_SCENE = {"cameras": 8, "frames": 120, "size": (640, 480), "fps": 60.0}
_QUICK = {"cameras": 3, "frames": 8, "size": (160, 120), "fps": 60.0}
_QUICK_FLAGS = ("--particles=40", "--layers=3", "--voxel-size=0.05")
_DISTINCT = 2  # takes that are generated; they are tracked repeatedly under other names


def register(commands: argparse._SubParsersAction) -> None:
    parser = add_command(commands, "batch", run, help="takes per minute by workers")
    add_timing_flags(parser)
    parser.add_argument(
        "--start", choices=("true", "found"), default="true", help="given, or found in every take"
    )
    parser.add_argument(
        "--at-once", type=int, nargs="+", default=_AT_ONCE, metavar="N", help="takes on each GPU"
    )
    parser.add_argument(
        "--each", type=int, default=_PER_WORKER, metavar="N",
        help="takes of each worker that count (%(default)s); of few, when they end is chance",
    )  # fmt: skip
    parser.add_argument("--lean", action="store_true", help="without overlay and report")


def run(args: argparse.Namespace) -> None:
    scene = _QUICK if args.quick else _SCENE
    start, lean = args.start, args.lean
    settings = {
        "scene": scene,
        "start": start,
        "lean": lean,
        "each": args.each,
        "begin": "one after another",
    }
    results = Results.begin("batch", args, settings)
    with tempfile.TemporaryDirectory(prefix="apf-batch-") as folder:
        takes = _film(Path(folder) / "takes", scene)
        results.plan("decoding", partial(decoding, takes[0]))
        flags = (*(_QUICK_FLAGS if args.quick else ()), "--all-cameras")
        flags += ("--no-overlay", "--no-report") if lean else ()
        measured = clusters(args.quick, args.at_once)
        first = next(iter(measured.values()))
        results.plan("compiling", partial(compiling, first[0], takes, Path(folder) / "once", flags))
        # The largest first: if the time runs out, the least informative rows are left out.
        for label, shares in reversed(measured.items()):
            out = Path(folder) / label.replace(" ", "_").replace(",", "")
            per_worker = 1 if args.quick else args.each
            measure = partial(throughput, shares, takes, out, flags, start == "true", per_worker)
            results.plan(f"workers {label}", measure)
        results.measure()
    for grid in tables(results):
        grid.show()


def clusters(quick: bool, at_once: Sequence[int] = _AT_ONCE) -> dict[str, list[Share]]:
    """Return the workers of every cluster that is measured, by its label. at_once: takes on a
    GPU."""
    n_gpus = sum(place.cores is None for place in places())
    if n_gpus:
        found = {f"1 GPU, {n} at once": share_machine("gpu:0", n) for n in at_once}
        if n_gpus > 1:
            found |= {f"2 GPUs, {2 * n} at once": share_machine("gpu", 2 * n)
                      for n in at_once[-2:]}  # fmt: skip
        return found
    cores = list_own_cores()
    found = {}
    n = 1
    while n <= len(cores):
        groups = [tuple(cores[k::n]) for k in range(n)]
        found[f"{n} of {len(groups[0])} cores"] = [Share("cpu", group) for group in groups]
        n *= 2
    # Baseline without pinning: as many workers, each with all cores.
    found[f"{len(cores)} not pinned"] = [Share("cpu", tuple(cores))] * len(cores)
    return dict(list(found.items())[-2:]) if quick else found


def _film(folder: Path, scene: dict[str, Any]) -> list[Path]:
    device = Device.best()
    takes = [folder / f"walk{seed}" for seed in range(_DISTINCT)]
    for seed, take in enumerate(takes):
        generate(take, SceneConfig(seed=seed, **scene), device)
    return takes


def decoding(take: Path) -> dict[str, float]:
    """Measure the time of reading a frame of all cameras, ms, and the CPU time of it."""
    sequence = Footage.open(take)
    began, worked = time.perf_counter(), time.process_time()
    n = sum(1 for _ in sequence.frames(slice(None)))
    wall, processor = time.perf_counter() - began, time.process_time() - worked
    return {"frames": n, "ms": 1e3 * wall / n, "core_ms": 1e3 * processor / n}


def compiling(
    share: Share, takes: Sequence[Path], out: Path, flags: Sequence[str]
) -> dict[str, float]:
    """Return the time, s, of the first takes, one of each at once on workers with this share."""
    began = time.perf_counter()
    with Processes([share] * len(takes)) as pool:
        list(_done(pool, [_task(take, out, take.name, flags, True) for take in takes]))
    return {"seconds": time.perf_counter() - began}


def throughput(
    shares: Sequence[Share], takes: Sequence[Path], out: Path, flags: Sequence[str], given: bool,
    per_worker: int,
) -> dict[str, Any]:  # fmt: skip
    """Measure takes per minute of workers with these shares while all are busy; time, s, of such a
    take in each stage, and its CPU time, s."""
    n_workers, began = len(shares), 0.0

    def task(name: str, number: int, given: bool, *more: str) -> Task:
        return _task(takes[number % len(takes)], out, f"{name}{number}", (*flags, *more), given)

    def one_after_another(apart: float) -> Iterator[Task]:
        """Yield takes without end; the first takes of the workers begin `apart` s after each
        other."""
        nonlocal began
        for n in itertools.count():
            if n < n_workers:
                time.sleep(apart * (n > 0))
                began = time.perf_counter()
            yield task("take", n, given)

    with Processes(shares) as pool:
        short = [task("short", n, True, "--frames=0:3") for n in range(n_workers)]
        took = sum(sum(stages.values()) for _, stages, _ in _done(pool, short)) / n_workers
        with closing(_done(pool, one_after_another(took / n_workers))) as without_end:
            done = list(itertools.islice(without_end, per_worker * n_workers))
            seconds = time.perf_counter() - began
    frames = sum(row.frames or 0 for one, *_ in done for row in one.rows)
    return {
        "workers": n_workers,
        "gpus": len({share.device for share in shares if not share.cores}),
        "takes": len(done),
        "seconds": seconds,
        "per_minute": 60 * len(done) / seconds,
        "frames_per_s": frames / seconds,
        "stages": _means([stages for _, stages, _ in done]),
        "core_stages": (core_stages := _means([stages for *_, stages in done])),
        "core_s": sum(core_stages.values()),
    }


def _task(take: Path, out: Path, name: str, flags: Sequence[str], given: bool) -> Task:
    """Return the task of `apf batch` for a take; given: start at the true first pose."""
    words = [str(take), f"--output={out / name}", *flags]
    words += [f"--init={take / 'truth.npz'}"] * given
    args = program_parser("apf", "", COMMANDS).parse_args(["track", *words])
    request = TrackRequest.from_stated(find_stated(TrackRequest, args))
    job = TakeJob(name, request, out / "log")
    return Task(name, process_timed, (job,))


def process_timed(progress: TaskProgress, job: TakeJob) -> TimedTake:
    """Process a take; return it with the time of each stage, s, and its CPU time, s."""
    seconds, core_seconds = defaultdict[str, float](float), defaultdict[str, float](float)
    enter, stage, begun = progress._enter, "", (time.monotonic(), time.process_time())

    def switch(to: str) -> None:
        nonlocal stage, begun
        now = time.monotonic(), time.process_time()
        seconds[stage] += now[0] - begun[0]
        core_seconds[stage] += now[1] - begun[1]
        stage, begun = to, now
        enter(to)

    progress._enter = switch  # type: ignore[method-assign]
    done = process_take(progress, job)
    switch("")
    del seconds[""], core_seconds[""]  # before the first stage
    return done, dict(seconds), dict(core_seconds)


def _means(of_takes: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the mean of every stage."""
    sums: Counter[str] = Counter()
    for stages in of_takes:
        sums.update(stages)
    return {stage: total / len(of_takes) for stage, total in sums.items()}


def _done(pool: Pool, tasks: Iterable[Task]) -> Generator[TimedTake, None, None]:
    named = ((task.name, partial(pool.run, task)) for task in tasks)
    with closing(pool.outcomes(named)) as outcomes:
        for name, outcome in outcomes:
            if isinstance(outcome, BaseException):
                raise InputError(f"{name}: {outcome}")
            yield outcome


def tables(results: Results) -> list[Grid]:
    """Return tables: takes per minute, time of a take by stage, decoding cores."""
    rows = {
        name.removeprefix("workers "): section
        for name, section in results.sections.items()
        if name.startswith("workers ")
    }
    # Ascending by computing power, in whichever order they were measured.
    rows = dict(sorted(rows.items(), key=_size))
    grids = [throughput_table(rows), stages_table(rows)] if rows else []
    if any("core_stages" in row for row in rows.values()):
        grids.append(stages_table(rows, "core_stages", "CPU time of a take, s of a core"))
    if rows and "decoding" in results.sections:
        grids.append(decoding_table(results.sections["decoding"], rows))
    return grids


def _size(row: tuple[str, Any]) -> tuple[int, int, bool]:
    label, of = row
    return of["gpus"], of["workers"], "not" in label


def throughput_table(rows: dict[str, Any]) -> Grid:
    """Return the efficiency, takes per minute and worker against the first row's, and the speed-up
    against it."""
    first = next(iter(rows.values()))
    return Grid(
        "Takes per minute",
        ["workers", "takes", "takes/min", "frames/s", "speed-up", "efficiency",
         "core s/take", "cores busy"],
        [
            [
                label, str(row["takes"]), number(row["per_minute"]), number(row["frames_per_s"]),
                f"{row['per_minute'] / first['per_minute']:.2f} x",
                f"{100 * row['per_minute'] / first['per_minute'] / _units(row, first):.0f} %",
                number(row["core_s"]), number(row["core_s"] * row["per_minute"] / 60),
            ]
            for label, row in rows.items()
        ],
    )  # fmt: skip


def _units(row: Any, first: Any) -> float:
    """Return the computing power against the first row: number of GPUs; 1 for a CPU, which always
    uses all cores."""
    return max(1, row["gpus"]) / max(1, first["gpus"])


def stages_table(
    rows: dict[str, Any], of: str = "stages", title: str = "Where a take's time goes, s"
) -> Grid:
    """Return a table of each row's stages, under the key `of`."""
    stages = list(dict.fromkeys(stage for row in rows.values() for stage in row.get(of, {})))
    spent = {
        label: [number(row.get(of, {}).get(stage, 0.0)) for stage in stages]
        for label, row in rows.items()
    }
    found = [[label, *cells] for label, cells in spent.items()]
    return Grid(title, ["workers", *stages], found)


def decoding_table(decoding: Any, rows: dict[str, Any]) -> Grid:
    """Return the number of cores that decode as many frames per second as the workers track."""
    return Grid(
        f"Decoding: {number(decoding['core_ms'])} ms of a core per frame of all cameras",
        ["workers", "cores that decode", "frames/s"],
        [
            [label, number(row["frames_per_s"] * decoding["core_ms"] / 1e3),
             number(row["frames_per_s"])]
            for label, row in rows.items()
        ],
    )  # fmt: skip
