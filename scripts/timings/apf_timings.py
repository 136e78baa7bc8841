"""`compare_timings.py apf`: how many hypotheses are scored per second, and a frame's two halves.

Against particles, layers and cameras, on every device, on one core, and by the NumPy twin.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from apf.filters.annealed import AnnealedParticleFilter, make_voxel_likelihood
from apf.reference.filters.annealed import numpy_voxel_likelihood
from cl import NumpyDevice
from psfs.cli.commandline import add_command
from psfs.reconstructor import Reconstructor
from psfs.reference.reconstructor import NumpyReconstructor
from timings.bench_scene import SHAPE, VIEWS, make_grid, playing
from timings.measure import (
    Place,
    Timing,
    apart,
    cpu_place,
    fewer_cores,
    only_cores,
    places,
    time_calls,
)
from timings.results import Results, add_timing_flags
from timings.tables.apf import print_report
from timings.whole_frame import Problem, make_problem

#: Hypotheses that all devices evaluate at once, and the numbers of hypotheses and layers for
#: growth.
SCORED = 2000
PARTICLES = (50, 200, 500, 1000, 2000, 5000, 10_000, 20_000)
LAYERS = (1, 2, 5, 10, 20)
CAMERAS = (1, 2, 4, 6, 8)
#: Number of frames on a part of the cores, which take long.
_RUNS_ON_FEW = 8
#: Number of frames for each value of a growing setting.
_GROWTH_RUNS = 15
#: Largest number of particles on a CPU: more take seconds each.
_MOST_ON_CPU = 5000
#: Hypotheses for the twin, which takes seconds for these; its time grows linearly.
_SCORED_BY_TWIN = 50


def register(commands: argparse._SubParsersAction) -> None:
    parser = add_command(commands, "apf", _run, help="the tracker: hypotheses scored per second")
    add_timing_flags(parser)


def _run(args: argparse.Namespace) -> None:
    found, quick = places(), args.quick
    runs = 8 if quick else 40
    problem = make_problem(6 if quick else 20)
    settings = {"views": VIEWS, "shape": SHAPE, "scored": SCORED, "filter": problem.config.settings}
    results = Results.begin("apf", args, settings)
    results.plan("numpy", partial(by_twin, problem), quick=False)
    for place in found:
        for cores in fewer_cores(place):
            measure = partial(apart, only_cores(cores), _on_cpu, problem, min(runs, _RUNS_ON_FEW))
            results.plan(f"device {place.label}, {cores} used", measure, quick=False)
        results.plan(f"device {place.label}", partial(on_place, place, problem, runs))
    for place in found:
        for what, measure in _growths(place, problem).items():
            results.plan(f"{what}, {place.label}", measure, quick=False)
    results.measure()
    print_report(results)


def by_twin(problem: Problem) -> dict[str, Any]:
    """Measure the evaluation by the NumPy twin."""
    scene, grid, device = problem.scene, make_grid(problem.shape), NumpyDevice()
    reconstruct = NumpyReconstructor(device, scene.rig, grid, scene.background)
    likelihood = numpy_voxel_likelihood(problem.on(device), problem.config)
    likelihood.observe(reconstruct(scene.frames[0]))
    poses = spread(problem, _SCORED_BY_TWIN)
    scoring = time_calls(lambda: likelihood(poses), 3, warm_up=0)
    return {"scored": _SCORED_BY_TWIN, "scoring": scoring}


def _on_cpu(problem: Problem, runs: int) -> dict[str, Any]:
    return on_place(cpu_place(), problem, runs)


def on_place(place: Place, problem: Problem, runs: int) -> dict[str, Any]:
    """Measure one device: evaluation, both halves of a frame by the clock, kernels by events."""
    return {
        "label": place.label,
        "scoring": scoring(place, problem, SCORED, runs),
        **halves(place, problem, runs),
        "kernels": kernels(place, problem, runs),
    }


def spread(problem: Problem, n: int) -> np.ndarray:
    """Return (n, D) float32 poses with the spread of a first layer."""
    noise = np.random.default_rng(0).normal(size=(n, problem.body.n_dof))
    poses = problem.pose + problem.config.search.noise * problem.body.sigma * noise
    return poses.astype(np.float32)


def scoring(place: Place, problem: Problem, n: int, runs: int) -> Timing:
    """Measure the wall-clock time of one evaluation of `n` poses, with given voxels and maps."""
    device, scene, grid = place.device(), problem.scene, make_grid(problem.shape)
    reconstruct = Reconstructor(device, scene.rig, grid, scene.background)
    config = problem.config.with_changes(n_particles=n)
    likelihood = make_voxel_likelihood(problem.on(device), config)
    likelihood.observe(reconstruct(scene.frames[0]))
    launches = likelihood.launcher(device.to_device(spread(problem, n)))

    def score() -> None:
        for launch in launches:
            launch()
        device.finish()

    return time_calls(score, runs, 3)


class Halves:
    """A reconstructor and a tracker on an endless scene."""

    def __init__(self, place: Place, problem: Problem, profile: bool = False) -> None:
        scene, grid = problem.scene, make_grid(problem.shape)
        self.device = place.device(profile)
        self.reconstruct = Reconstructor(self.device, scene.rig, grid, scene.background)
        self.tracker = AnnealedParticleFilter(problem.on(self.device), problem.config)
        self.tracker.start(problem.pose)
        self._frames = playing(scene.frames)

    def both(self) -> None:
        """Run a frame from images to pose."""
        self.tracker.step(self.reconstruct(next(self._frames)))

    def reconstruction(self) -> None:
        """Run a frame from images to voxels, which stay on the device."""
        self.reconstruct(next(self._frames))
        self.device.finish()

    def tracking(self) -> None:
        """Run a frame from the current voxels to the pose."""
        self.tracker.step(self.reconstruct.voxels)


def halves(place: Place, problem: Problem, runs: int) -> dict[str, Timing]:
    """Measure by the clock: both halves of a frame together, and each alone."""
    at_work = Halves(place, problem)
    return {
        "both": time_calls(at_work.both, runs, 3),
        "reconstruction": time_calls(at_work.reconstruction, runs, 1),
        "tracking": time_calls(at_work.tracking, runs, 1),
    }


def kernels(place: Place, problem: Problem, runs: int) -> dict[str, dict[str, Timing]]:
    """Measure by the device's events: time per frame of every kernel and copy, by half."""
    at_work = Halves(place, problem, profile=True)
    profiler = at_work.device.profiler
    assert profiler is not None
    rows: dict[str, dict[str, list[float]]] = {"reconstruction": {}, "tracking": {}}
    for run in range(runs + 2):
        for half, kept in rows.items():
            profiler.clear()
            getattr(at_work, half)()
            for name, ms in profiler.collect().items():
                if run >= 2:
                    kept.setdefault(name, []).append(sum(ms))
    return {
        half: {name: Timing(tuple(ms)) for name, ms in kept.items()} for half, kept in rows.items()
    }


def _growths(place: Place, problem: Problem) -> dict[str, Callable[[], Any]]:
    most = _MOST_ON_CPU if place.cores else max(PARTICLES)
    particles = tuple(n for n in PARTICLES if n <= most)
    counts = {"particles": particles, "layers": LAYERS, "cameras": CAMERAS}
    return {what: partial(growth, place, problem, what, values) for what, values in counts.items()}


def growth(
    place: Place, problem: Problem, what: str, values: tuple[int, ...]
) -> list[dict[str, Any]]:
    """Return a row per value of the setting `what`, with all others fixed: evaluation, and the
    halves of a frame."""
    rows = []
    for value in values:
        name = {"particles": "n_particles", "layers": "n_layers"}.get(what, what)
        changed = problem.smaller(**{name: value})
        scored = value if what == "particles" else SCORED
        row: dict[str, Any] = {"value": value, "scored": scored, "cameras": len(changed.scene.rig)}
        if what != "layers":
            row["scoring"] = scoring(place, changed, scored, _GROWTH_RUNS)
        rows.append(row | halves(place, changed, _GROWTH_RUNS))
    return rows
