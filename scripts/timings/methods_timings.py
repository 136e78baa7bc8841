"""`compare_timings.py methods`: particle swarm and particle filter over the images' objective.

Whole frames, from pictures in host memory to the pose: silhouettes, edges, distance maps, and the
search that renders the body model for every particle. The settings of Rymut 2016, tables 6.2 to
6.6: four cameras, 10 iterations of the swarm.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from apf.backend import features_for, tracker_for
from apf.filters.method import Method
from apf.image_objective.config import ObjectiveConfig
from psfs.cli.commandline import add_command
from timings.bench_scene import FPS, playing
from timings.measure import Place, Timing, places
from timings.results import Results, add_timing_flags
from timings.tables.methods import print_report
from timings.whole_frame import Problem, make_problem

VIEWS, ITERATIONS, OBJECTIVE = 4, 10, "sp"
#: Particles of the swarm and of the filter whose frames are timed: tables 6.2, 6.3 and 6.6.
_SWARM, _FILTER = (100, 200, 300, 400, 1000), (1000, 2000, 3000, 4000)
#: Evaluations of the objective per frame: table 6.4.
_EVALUATIONS = (960, 2040, 3040, 5120)
#: Vertices per part of the body's shape, and particles: table 6.5.
_VERTICES, _SHAPE_PARTICLES = (4, 8, 18, 34, 66, 130, 258, 514), (96, 304)


#: Frames of the walk, and with `--quick`, which times fewer searches, too.
_FRAMES, _QUICK_FRAMES = 40, 6


def register(commands: argparse._SubParsersAction) -> None:
    parser = add_command(
        commands, "methods", _run, help="swarm and particle filter over the images' objective"
    )
    add_timing_flags(parser)


def _run(args: argparse.Namespace) -> None:
    found, quick = places(), args.quick
    n_frames = _QUICK_FRAMES if quick else _FRAMES
    swarm, filters = (_SWARM[::4], _FILTER[:1]) if quick else (_SWARM, _FILTER)
    settings = {"views": VIEWS, "iterations": ITERATIONS, "objective": OBJECTIVE,
                "frames": n_frames}  # fmt: skip
    results = Results.begin("methods", args, settings)
    problem = make_problem(n_frames).smaller(cameras=VIEWS)
    for place in found:
        efforts = [("pso", n) for n in swarm] + [("sir", n) for n in filters]
        results.plan(f"frames {place.label}", partial(frames, place, problem, efforts))
    for place in found:
        measure = partial(shapes, place, problem)
        results.plan(f"shapes {place.label}", measure, quick=False)
    accuracy = [("pso", n // ITERATIONS) for n in _EVALUATIONS]
    accuracy += [("sir", n) for n in _EVALUATIONS]
    results.plan("accuracy", partial(frames, found[0], problem, accuracy), quick=False)
    results.measure()
    print_report(results)


def frames(place: Place, problem: Problem, efforts: Sequence[tuple[str, int]]) -> dict[str, Any]:
    """A row for every search and number of particles."""
    rows = [
        {"search": search, "particles": n, **tracked(place, problem, _method(search, n))}
        for search, n in efforts
    ]
    return {"label": place.label, "cores": place.cores, "rows": rows}


def shapes(place: Place, problem: Problem) -> dict[str, Any]:
    """A row for every shape of the body's parts and number of particles, with the swarm."""
    rows = []
    for vertices in _VERTICES:
        for n in _SHAPE_PARTICLES:
            image = ObjectiveConfig(kind=OBJECTIVE, vertices_per_part=vertices)
            method = replace(_method("pso", n), image=image)
            run = tracked(place, problem, method)
            rows.append({"vertices": vertices, "particles": n, **run})
    return {"label": place.label, "cores": place.cores, "rows": rows}


def _method(search: str, particles: int) -> Method:
    layers = ITERATIONS if search == "pso" else 1
    method = Method.of(search, OBJECTIVE, n_particles=particles, n_layers=layers)
    return replace(method, filter=method.filter.at_rate(FPS))


def tracked(place: Place, problem: Problem, method: Method) -> dict[str, Any]:
    """The scene once through after a warm-up: ms per frame by the clock, and the mean error."""
    device, scene = place.device(), problem.scene
    features = features_for(device, scene.rig, scene.background, method.features)
    tracker = tracker_for(problem.on(device), method)
    ms: list[float] = []
    errors: list[float] = []
    n = len(scene.frames)
    for warm_up, count in ((True, min(2, n)), (False, n)):
        tracker.start(problem.pose)
        for place_, frame in enumerate(islice(playing(scene.frames), count)):
            started = time.perf_counter()
            features(frame)
            estimate = tracker.step(features)
            passed = time.perf_counter() - started
            if not warm_up:
                ms.append(1e3 * passed)
                errors.append(problem.error_mm(place_, estimate.pose))
    return {"frames": Timing(tuple(ms)), "error_mm": float(np.mean(errors))}
