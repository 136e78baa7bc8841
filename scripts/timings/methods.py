"""`compare_timings.py methods`: particle swarm and particle filter over the images' objective.

Whole frames, from pictures in host memory to the pose: silhouettes, edges, distance maps, and the
search that renders the body model `rymut31` for every particle. The settings of Rymut 2016, tables
6.2 to 6.4 and 6.6: four cameras, 10 iterations of the swarm where they do not vary.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from apf.backend import check_renderer, make_feature_extractor, make_tracker
from apf.filters.method import Method
from apf.image_objective.config import ObjectiveConfig
from apf.timings.measure import Place, Timing, places
from apf.timings.scene import FPS, Problem, make_problem
from psfs.sequence import Frame
from timings.grid import Grid, number
from timings.results import Results, add_command, add_timing_flags

#: Their names in the thesis.
SEARCHES = {"pso": "PSO", "sir": "PF"}
VIEWS, ITERATIONS, OBJECTIVE = 4, 10, "sp"
#: Particles of the swarm and of the filter for timed frames: tables 6.2, 6.3 and 6.6.
_SWARM, _FILTER, _OPENGL = (
    (100, 200, 300, 400, 1000),
    (1000, 2000, 3000, 4000),
    (100, 200, 300, 400),
)
#: Evaluations of the objective per frame: table 6.4.
_EVALUATIONS = (960, 2040, 3040, 5120)
#: Frames of the walk, and with `--quick`, which also times fewer searches.
_FRAMES, _QUICK_FRAMES = 40, 6
#: Time, s, after which a row has enough frames: OpenGL in software is slow.
_ENOUGH = 12.0


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
    problem = make_problem(n_frames, "rymut31", VIEWS)
    efforts = [("pso", n) for n in swarm] + [("sir", n) for n in filters]
    accuracy = [("pso", n // ITERATIONS) for n in _EVALUATIONS]
    accuracy += [("sir", n) for n in _EVALUATIONS]
    results.plan("accuracy", partial(frames, found[0], problem, accuracy), quick=False)
    for place in found:
        here = place.label
        results.plan(f"frames {here}", partial(frames, place, problem, efforts))
        if place is found[0]:
            opengl = [("pso", n) for n in (_OPENGL[:1] if quick else _OPENGL)]
            by_opengl = partial(frames, place, problem, opengl, "opengl")
            results.plan(f"opengl frames {here}", by_opengl)
    results.measure()
    for grid in tables(results):
        grid.show()


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


def tables(results: Results) -> list[Grid]:
    """Return a table for each device and renderer."""
    grids = []
    for name, section in results.sections.items():
        if name.startswith(("frames ", "opengl ")):
            by = ", drawn by OpenGL" if name.startswith("opengl ") else ""
            grids.append(frames_table(section, section["label"] + by, results.settings))
    return grids


def frames_table(section: Any, title: str, settings: Any) -> Grid:
    """Return time and error of whole frames by search and particles."""
    rows = [
        [_search(row, settings), f"{row['particles']:,}", str(row["frames"]),
         number(1e3 / row["frames"].median), number(row["error_mm"])]
        for row in section["rows"]
    ]  # fmt: skip
    return Grid(
        f"Whole frames on {title}",
        ["search", "particles", "ms, median [quartiles]", "frames/s", "error, mm"], rows,
    )  # fmt: skip


def _search(row: Any, settings: Any) -> str:
    name = SEARCHES[row["search"]]
    return f"{name}, {settings['iterations']} iterations" if row["search"] == "pso" else name
