"""`compare_timings.py whole`: Song et al.'s whole algorithm in the columns of their tables 2 to 4.

Reconstruction, colour and tracking, from pictures in host memory to pose and coloured voxels in
host memory, in NumPy on one thread, in OpenCL on one core and on all cores of the CPU, and on every
GPU: the same settings, frames and random numbers in each. All of it by the defaults, and in OpenCL
by `--preset song` as well, which is what the paper describes and nothing else.
"""

from __future__ import annotations

import argparse
import tempfile
from functools import partial
from typing import Any

import cv2
import numpy as np

from cl import NumpyDevice
from psfs.cli.commandline import add_command
from timings.bench_scene import SHAPE, VIEWS, make_grid
from timings.measure import (
    Place,
    Timing,
    apart,
    cpu_place,
    fewer_cores,
    measured_limits,
    only_cores,
    places,
)
from timings.results import Results, add_timing_flags
from timings.stages import reconstruction_work, tracking_work
from timings.streamed_cues import streamed_cues
from timings.tables.whole import print_report
from timings.whole_frame import (
    Problem,
    WholeFrame,
    make_problem,
    sequence_run,
    songs_own,
    stage_times,
    stream_run,
)

#: Song et al.: frames of a run, and runs.
FRAMES, REPETITIONS = 200, 3
#: Frames of a streamed run with or without a cue.
_STREAMED = 100
#: Number of their surface voxels, approximate (3.3.3, e).
SONGS_SURFACE = 30_000
#: Frames of a NumPy run: the twins take seconds for each.
_NUMPY_FRAMES = 5
#: Distinct frames of the walk, played there and back.
_SCENE_FRAMES, _QUICK_SCENE_FRAMES = 40, 6
#: Environment that limits the libraries below NumPy to one thread.
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
#: Values of the varied settings, all others being Song et al.'s; cameras and voxels cost
#: reconstruction and tracking.
_SCALED: dict[str, tuple[Any, ...]] = {
    "shape": ((75, 75, 50), (110, 110, 74), SHAPE, (212, 212, 142), (300, 300, 200)),
    "cameras": (2, 4, 6, 8),
    "n_particles": (50, 100, 200, 400, 800),
    "n_layers": (1, 5, 10, 20),
}


def register(commands: argparse._SubParsersAction) -> None:
    parser = add_command(commands, "whole", run, help="Song et al.'s whole algorithm, tables 2-4")
    add_timing_flags(parser)


def run(args: argparse.Namespace) -> None:
    found, quick = places(), args.quick
    problem = make_problem(_QUICK_SCENE_FRAMES if quick else _SCENE_FRAMES)
    frames = {"opencl": 4 if quick else FRAMES, "numpy": 2 if quick else _NUMPY_FRAMES}
    repetitions = {"opencl": REPETITIONS, "numpy": 1 if quick else REPETITIONS}
    settings = {
        "views": VIEWS,
        "shape": SHAPE,
        "filter": problem.config.settings,
        "frames": frames,
        "repetitions": repetitions,
        "distinct_frames": len(problem.scene.frames),
    }
    results = Results.begin("whole", args, settings)
    _columns(results, found, problem)
    for place in found:
        profiled = partial(roofline, place, problem, 3 if quick else 10)
        results.plan(f"stages {place.label}", profiled)
    for place in found:
        run = (4, 1) if quick else (_STREAMED, REPETITIONS)
        most = 5.0 if place.cores is None else 1.5
        results.plan(f"cues {place.label}", partial(streamed_cues, place, problem, *run, most))
    for place in found:
        for cores in fewer_cores(place)[1:]:
            measure = partial(apart, only_cores(cores), on_cpu, problem, 8, 1, np.inf)
            results.plan(f"cores {cores}", measure, quick=False)
    _numpy_column(results, problem)
    for place in found:
        results.plan(f"surface {place.label}", partial(finer, place, problem), quick=False)
        measure = partial(compilation, place, problem)
        results.plan(f"compilation {place.label}", measure, quick=False)
    for place in found:
        for what in _SCALED:
            measure = partial(scaling, place, problem, what)
            results.plan(f"scaling {what}, {place.label}", measure, quick=False)
    results.measure()
    print_report(results)


def _columns(results: Results, found: list[Place], problem: Problem) -> None:
    """Measure the columns of Song et al.'s tables, by the defaults and by `--preset song`; with
    limited time, shorter runs."""
    frames, repetitions = results.settings["frames"], results.settings["repetitions"]
    size = frames["opencl"], repetitions["opencl"]
    both = {"column": problem, "song": songs_own(problem)}  # one after the other, to be compared
    for place in found:
        share = 0.1 if place.cores is None else 0.15
        seconds = share * results.budget / repetitions["opencl"]
        for name, which in both.items():
            results.plan(f"{name} {place.label}", partial(column, place, which, *size, seconds))
    seconds = 0.15 * results.budget / repetitions["opencl"]
    for name, which in both.items():
        one = partial(apart, only_cores(1), on_cpu, which, *size, seconds)
        if any((place.cores or 1) > 1 for place in found):
            results.plan(f"{name} one core", one)


def _numpy_column(results: Results, problem: Problem) -> None:
    frames, repetitions = (results.settings[k]["numpy"] for k in ("frames", "repetitions"))
    begin = 1 if results.settings["quick"] else 0
    twins = (problem, frames, repetitions, 0.2 * results.budget / repetitions, begin)
    results.plan("column NumPy", partial(apart, _ONE_THREAD, on_numpy, *twins))


def column(
    place: Place, problem: Problem, frames: int, repetitions: int, seconds: float
) -> dict[str, Any]:
    """Measure `repetitions` runs through `frames` frames, each of at most `seconds`, after a
    warm-up."""
    device = place.device()
    whole = WholeFrame(device, problem)
    first = sequence_run(whole, 3)["frames"].samples[0]
    runs = [sequence_run(whole, frames, seconds) for _ in range(repetitions)]
    held = problem.scene.pin(device)
    per_run = len(runs[-1]["frames"].samples)
    return {
        "label": place.label,
        "kind": device.info.kind,
        "cores": place.cores,
        "setup_ms": whole.setup_ms,
        "first_frame_ms": first,
        "runs": runs,
        "to_cloud": stream_run(whole, held, per_run, seconds, coloured=True),
        "to_pose": stream_run(whole, held, per_run, seconds),
    }


def on_cpu(problem: Problem, frames: int, repetitions: int, seconds: float) -> dict[str, Any]:
    """Measure `column` on this process's CPU."""
    return column(cpu_place(), problem, frames, repetitions, seconds)


def on_numpy(
    problem: Problem, frames: int, repetitions: int, seconds: float, begin: int
) -> dict[str, Any]:
    """Measure `column` for the NumPy twins, without a warm-up, because there is nothing to
    compile."""
    cv2.setNumThreads(1)
    whole = WholeFrame(NumpyDevice(), problem)
    runs = [sequence_run(whole, frames, seconds, begin) for _ in range(repetitions)]
    return {"label": "NumPy, 1 thread", "kind": "numpy", "cores": 1, "runs": runs}


def roofline(place: Place, problem: Problem, frames: int) -> dict[str, Any]:
    """Measure stages by the device's events; return bytes, operations, and the device's limits,
    measured now."""
    limits = measured_limits(place)
    whole = WholeFrame(place.device(profile=True), problem)
    stages = stage_times(whole, frames)
    surface = int(sequence_run(whole, 2)["surface_voxels"])
    work = reconstruction_work(problem.scene, make_grid(problem.shape), surface)
    work |= tracking_work(problem.scene, problem.body, problem.config, surface)
    return {"label": place.label, "limits": limits, "stages": stages, "work": work}


def scaling(place: Place, problem: Problem, what: str) -> list[dict[str, Any]]:
    """Measure whole frames (without the first) while one setting varies: rows of its value and
    times."""
    rows = []
    for value in _SCALED[what]:
        whole = WholeFrame(place.device(), problem.smaller(**{what: value}))
        frames = sequence_run(whole, 9)["frames"].samples[1:]
        rows.append({"value": value, "frames": Timing(frames)})
    return rows


def finer(place: Place, problem: Problem) -> dict[str, Any]:
    """Measure whole frames in a grid so fine that the surface has about `SONGS_SURFACE` voxels."""
    whole = WholeFrame(place.device(), problem)
    surface = sequence_run(whole, 2)["surface_voxels"]
    shape = problem.shape
    for _ in range(2):  # the surface grows slightly slower than the square of the grid's sides
        factor = (SONGS_SURFACE / surface) ** 0.5
        nx, ny, nz = (round(n * factor) for n in shape)
        shape = nx, ny, nz
        whole = WholeFrame(place.device(), problem.smaller(shape=shape))
        surface = sequence_run(whole, 2)["surface_voxels"]
    run = sequence_run(whole, 21, seconds=20)
    frames = Timing(run["frames"].samples[1:])
    return {"label": place.label, "cores": place.cores, "shape": shape, "frames": frames,
            "surface_voxels": run["surface_voxels"], "error_mm": run["error_mm"]}  # fmt: skip


def compilation(place: Place, problem: Problem) -> dict[str, float]:
    """Measure the whole setup, ms, including the first frame, with empty and with filled compiler
    caches."""
    with tempfile.TemporaryDirectory() as folder:
        names = ("POCL_CACHE_DIR", "XDG_CACHE_HOME", "CUDA_CACHE_PATH")
        caches = dict.fromkeys(names, folder)
        return {
            state: apart(caches, _set_up, place.label, problem) for state in ("empty", "filled")
        }


def _set_up(label: str, problem: Problem) -> float:
    place = next(place for place in places() if place.label == label)
    whole = WholeFrame(place.device(), problem)
    return whole.setup_ms + sequence_run(whole, 1)["frames"].samples[0]
