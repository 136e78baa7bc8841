"""`compare_timings.py whole`: Song et al.'s whole algorithm in the columns of their tables 2 to 4.

Reconstruction, colour and tracking, from pictures in host memory to pose and coloured voxels in
host memory, in NumPy on one thread, in OpenCL on one core and on all cores of the CPU, and on every
GPU: the same settings, frames and random numbers in each. All of it by the defaults, and in OpenCL
by `--preset song` as well, which is what the paper describes and nothing else.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from apf.presets import preset
from apf.timings.measure import Place, apart, only_cores, places
from apf.timings.scene import (
    FPS,
    ONE_THREAD,
    SHAPE,
    VIEWS,
    Problem,
    WholeFrame,
    column,
    make_grid,
    make_problem,
    on_cpu,
    on_numpy,
    sequence_run,
)
from timings.measure import fewer_cores, measured_limits
from timings.results import Results, add_command, add_timing_flags
from timings.stages import reconstruction_work, stage_times, tracking_work
from timings.whole_tables import tables

#: Song et al.: frames of a run, and runs.
FRAMES, REPETITIONS = 200, 3
#: Frames of a NumPy run: the twins take seconds for each.
_NUMPY_FRAMES = 5
#: Distinct frames of the walk, played there and back.
_SCENE_FRAMES, _QUICK_SCENE_FRAMES = 40, 6


def songs_own(problem: Problem) -> Problem:
    """Return the problem with the settings of `--preset song`: the paper's algorithm and nothing
    else."""
    song = preset("song")
    config = song.method.filter.scale_to_rate(FPS)
    return replace(problem, config=config, reconstruction=song.reconstruction)


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
        for cores in fewer_cores(place)[1:]:
            measure = partial(apart, only_cores(cores), on_cpu, problem, 8, 1, np.inf)
            results.plan(f"cores {cores}", measure, quick=False)
    _numpy_column(results, problem)
    results.measure()
    for grid in tables(results):
        grid.show()


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
    results.plan("column NumPy", partial(apart, ONE_THREAD, on_numpy, *twins))


def roofline(place: Place, problem: Problem, frames: int) -> dict[str, Any]:
    """Measure stages by the device's events; return bytes, operations, and the device's limits,
    measured now."""
    limits = measured_limits(place)
    whole = WholeFrame(place.device(profile=True), problem)
    stages = stage_times(whole, frames)
    surface = int(sequence_run(whole, 2)["surface_voxels"])
    work = reconstruction_work(problem.scene.rig, make_grid(problem.shape), surface)
    work |= tracking_work(problem.scene.rig, problem.body, problem.config, surface)
    return {"label": place.label, "limits": limits, "stages": stages, "work": work}
