"""`compare_timings.py methods`: particle swarm and particle filter over the images' objective.

Whole frames, from pictures in host memory to the pose: silhouettes, edges, distance maps, and the
search that renders the body model `rymut31` for every particle. The settings of Rymut 2016, tables
6.2 to 6.6 and figures 6.9 to 6.23: four cameras, 10 iterations of the swarm where they do not vary.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from apf.backend import check_renderer, make_feature_extractor, make_tracker
from apf.filters.base import Tracker
from apf.filters.method import Method
from apf.filters.swarm import ParticleSwarm
from apf.image_objective.config import ObjectiveConfig
from apf.likelihood.base import Likelihood
from cl import Array, Device, Step
from psfs.cli.commandline import add_command
from psfs.sequence import Frame
from timings.bench_scene import FPS
from timings.measure import Place, Timing, places
from timings.results import Results, add_timing_flags
from timings.tables.methods import print_report
from timings.whole_frame import Problem, make_problem

VIEWS, ITERATIONS, OBJECTIVE = 4, 10, "sp"
#: Particles of the swarm and of the filter for timed frames: tables 6.2, 6.3 and 6.6.
_SWARM, _FILTER, _OPENGL = (
    (100, 200, 300, 400, 1000),
    (1000, 2000, 3000, 4000),
    (100, 200, 300, 400),
)
#: Evaluations of the objective per frame: table 6.4.
_EVALUATIONS = (960, 2040, 3040, 5120)
#: Vertices per part of the body's shape, and particles: table 6.5; Kwolek & Rymut, table 3.
_VERTICES, _SHAPE_PARTICLES = (4, 8, 18, 34, 66, 130, 258, 514), (96, 304)
#: Iterations and particles of the curves of figures 6.9, 6.10 and 6.19 to 6.21, and their seeds.
_ITERATIONS, _CURVES = (5, 10, 15, 20), (50, 100, 200, 300, 500, 800)
_SEEDS, _CPU_SEEDS = (0, 1, 2), (0,)
#: Particles of figures 6.11, 6.17 (shares of the time) and 6.23 (tracking while footage plays).
_SHARES, _ONLINE = (32, 100, 300, 500, 1000), (50, 100, 200, 300, 500, 800)
#: Frames of the walk, and with `--quick`, which also times fewer searches.
_FRAMES, _QUICK_FRAMES = 40, 6
#: Time, s, after which a row has enough frames: OpenGL in software is slow.
_ENOUGH = 12.0


class NoObjective(Likelihood):
    """An objective that gives all poses the same error in no time, to time the search alone."""

    def __init__(self, device: Device, n: int) -> None:
        self.errors = device.zeros((n,), np.float32)

    def observe(self, observation: Any) -> None:
        """Ignore the observation."""

    def launcher(self, poses: Array) -> list[Step]:
        """Return a function that does nothing."""
        return []


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
                "frames": n_frames, "fps": FPS, "body": "rymut31"}  # fmt: skip
    results = Results.begin("methods", args, settings)
    problem = make_problem(n_frames, "rymut31").smaller(cameras=VIEWS)
    efforts = [("pso", n) for n in swarm] + [("sir", n) for n in filters]
    accuracy = [("pso", n // ITERATIONS) for n in _EVALUATIONS]
    accuracy += [("sir", n) for n in _EVALUATIONS]
    results.plan("accuracy", partial(frames, found[0], problem, accuracy), quick=False)
    for place in found:
        here = place.label
        results.plan(f"frames {here}", partial(frames, place, problem, efforts))
        measure = partial(shares, place, problem, "opencl")
        results.plan(f"shares opencl, {here}", measure, quick=False)
        if place is found[0]:
            opengl = [("pso", n) for n in (_OPENGL[:1] if quick else _OPENGL)]
            by_opengl = partial(frames, place, problem, opengl, "opengl")
            results.plan(f"opengl frames {here}", by_opengl)
            measure = partial(shares, place, problem, "opengl")
            results.plan(f"shares opengl, {here}", measure, quick=False)
        results.plan(f"online {here}", partial(online, place, problem), quick=False)
        results.plan(f"curves {here}", partial(curves, place, problem), quick=False)
        results.plan(f"shapes {here}", partial(shapes, place, problem), quick=False)
    results.measure()
    print_report(results)


def frames(
    place: Place, problem: Problem, efforts: Sequence[tuple[str, int]], renderer: str = "opencl"
) -> dict[str, Any]:
    """Return a row for every search and number of particles."""
    rows = [
        {"search": search, "particles": n,
         **track_scene(place, problem, _method(search, n, renderer=renderer))}
        for search, n in efforts
    ]  # fmt: skip
    return {"label": place.label, "cores": place.cores, "rows": rows}


def shapes(place: Place, problem: Problem) -> dict[str, Any]:
    """Return a row for every shape of the body's parts and number of particles, with the swarm."""
    rows = []
    for vertices in _VERTICES:
        for n in _SHAPE_PARTICLES:
            run = track_scene(place, problem, _method("pso", n, vertices_per_part=vertices))
            rows.append({"vertices": vertices, "particles": n, **run})
    return {"label": place.label, "cores": place.cores, "rows": rows}


def curves(place: Place, problem: Problem) -> dict[str, Any]:
    """Return a row for every number of iterations and particles of the swarm; several seeds on a
    GPU."""
    rows = []
    for iterations in _ITERATIONS:
        for n in _CURVES:
            runs = [
                track_scene(place, problem, _method("pso", n, iterations, seed))
                for seed in (_SEEDS if place.cores is None else _CPU_SEEDS)
            ]
            ms = [ms for run in runs for ms in run["frames"].samples]
            errors = [run["error_mm"] for run in runs]
            rows.append({"iterations": iterations, "particles": n, "frames": Timing(tuple(ms)),
                         "errors_mm": errors})  # fmt: skip
    return {"label": place.label, "cores": place.cores, "rows": rows}


def shares(place: Place, problem: Problem, renderer: str) -> dict[str, Any]:
    """Return rows with the time of a frame's search, with given features, and of the same search
    without an objective."""
    device, rows = place.device(), []
    for n in _SHARES:
        method = _method("pso", n, renderer=renderer)
        check_renderer(device, method)
        scene = problem.on(device)
        nothing = ParticleSwarm(scene, NoObjective(device, n), method.filter, method.swarm)
        whole = _searches(device, problem, method, make_tracker(scene, method))
        rows.append({"particles": n, "search": whole,
                     "without": _searches(device, problem, method, nothing)})  # fmt: skip
    return {"label": place.label, "renderer": renderer, "cores": place.cores, "rows": rows}


def _searches(device: Device, problem: Problem, method: Method, tracker: Tracker) -> Timing:
    """Return the times, ms, of the tracker's step in every frame."""
    scene, ms = problem.scene, []
    features = make_feature_extractor(device, scene.rig, scene.background, method.features)
    tracker.start(problem.pose)
    for place, frame in enumerate(_within(_ENOUGH, scene.frames)):
        features(frame)
        device.finish()
        started = time.perf_counter()
        tracker.step(features)
        if place:  # the first step compiles
            ms.append(1e3 * (time.perf_counter() - started))
    return Timing(tuple(ms))


def online(place: Place, problem: Problem) -> dict[str, Any]:
    """Return rows with the error if every frame is tracked, and if footage plays at its own rate:
    then the next frame is the newest one when the previous one is done."""
    rows = []
    for n in _ONLINE:
        step = _stepper(place, problem, _method("pso", n))
        every = [step(k) for k in range(len(problem.scene.frames))]
        step = _stepper(place, problem, _method("pso", n))
        chosen, clock, k = [], 0.0, 0
        while k < len(problem.scene.frames):
            clock = max(clock, 1e3 * k / FPS)
            chosen.append(step(k))
            clock += chosen[-1][0]
            k = max(k + 1, int(1e-3 * clock * FPS))
        rows.append({"particles": n, "frames": Timing(tuple(ms for ms, _ in every[1:])),
                     "offline_mm": float(np.mean([mm for _, mm in every])),
                     "online_mm": float(np.mean([mm for _, mm in chosen])),
                     "share": len(chosen) / len(every)})  # fmt: skip
    return {"label": place.label, "cores": place.cores, "rows": rows}


def _stepper(
    place: Place, problem: Problem, method: Method
) -> Callable[[int], tuple[float, float]]:
    """Return a function, warmed up, that tracks the frame of a number and returns its time, ms, and
    error, mm."""
    device, scene = place.device(), problem.scene
    features = make_feature_extractor(device, scene.rig, scene.background, method.features)
    tracker = make_tracker(problem.on(device), method)

    def step(k: int) -> tuple[float, float]:
        started = time.perf_counter()
        features(scene.frames[k])
        estimate = tracker.step(features)
        return 1e3 * (time.perf_counter() - started), problem.error_mm(k, estimate.pose)

    tracker.start(problem.pose)
    step(0)
    step(0)
    tracker.start(problem.pose)
    return step


def _method(
    search: str, particles: int, iterations: int = ITERATIONS, seed: int = 0, **image: Any
) -> Method:
    layers = iterations if search == "pso" else 1
    method = Method.create(search, OBJECTIVE, n_particles=particles, n_layers=layers, seed=seed)
    looks = ObjectiveConfig(kind=OBJECTIVE, **image)
    return method.replace(filter=method.filter.scale_to_rate(FPS), image=looks)


def track_scene(place: Place, problem: Problem, method: Method) -> dict[str, Any]:
    """Track the scene once after a warm-up, as far as the time allows; return ms per frame by the
    clock, and the mean error."""
    device, scene = place.device(), problem.scene
    check_renderer(device, method)
    features = make_feature_extractor(device, scene.rig, scene.background, method.features)
    tracker = make_tracker(problem.on(device), method)
    ms: list[float] = []
    errors: list[float] = []
    n = len(scene.frames)
    for warm_up, frames in ((True, min(2, n)), (False, n)):
        tracker.start(problem.pose)
        for place_, frame in enumerate(_within(_ENOUGH, scene.frames[:frames])):
            started = time.perf_counter()
            features(frame)
            estimate = tracker.step(features)
            passed = time.perf_counter() - started
            if not warm_up:
                ms.append(1e3 * passed)
                errors.append(problem.error_mm(place_, estimate.pose))
    return {"frames": Timing(tuple(ms)), "error_mm": float(np.mean(errors))}


def _within(seconds: float, frames: Sequence[Frame]) -> Iterator[Frame]:
    """Yield `frames`: the first three in any case, the others until the time is over."""
    began = time.monotonic()
    for place, frame in enumerate(frames):
        if place < 3 or time.monotonic() - began < seconds:
            yield frame
