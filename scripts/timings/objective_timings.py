"""`compare_timings.py objective`: one evaluation of the images' objective for all hypotheses.

The rows of Rymut 2016, table 6.7, and of Kwolek & Rymut 2016, table 1: the NumPy twin, OpenCL on
every device, OpenGL with evaluation on the CPU, and OpenCL with OpenGL, where no picture leaves
OpenGL. On the synthetic walk: features of one frame, poses spread around the true one. Then the
same over frames by size of the work-groups that count pixels (Rymut 2016, fig. 6.16).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from apf.body.kinematics import posed_cones
from apf.body.model import BodyModel
from apf.image_objective.config import ObjectiveConfig
from apf.image_objective.features import Features
from apf.image_objective.objective import ImageObjective
from apf.image_objective.opengl import OpenGLObjective, OpenGLRenderer
from apf.likelihood.base import Likelihood
from apf.reference.image_objective.objective import count_pixels, image_areas, objective_values
from apf.reference.image_objective.render import Picture, draw_cones
from apf.scene import Scene
from cl import Array, Device
from psfs.cameras.camera import CameraRig
from psfs.cli.commandline import add_command
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
from timings.tables.objective import print_report
from timings.whole_frame import make_problem

#: The thesis's numbers of hypotheses and cameras.
HYPOTHESES, VIEWS = (96, 304, 512), 4
#: Hypotheses that the twin renders, and that OpenGL renders for the twin; times are scaled to all.
_TWIN_HYPOTHESES = 8
#: Fig. 6.16: hypotheses, frames; rows of OpenCL's work-groups, columns and rows of OpenGL's.
_GROUP_HYPOTHESES, _FRAMES, _QUICK_FRAMES = 512, 40, 6
_OPENCL_GROUPS = (32, 64, 128, 256)
_OPENGL_GROUPS = ((8, 8), (16, 8), (16, 16), (32, 8), (32, 16), (32, 32))
#: Time, s, after which a row has enough samples: OpenGL in software is slow.
_ENOUGH = 10.0


@dataclass(frozen=True, eq=False)
class Observed:
    """The input of the objective: a body and its pose (D,), cameras, and a frame's features on the
    host."""

    body: BodyModel
    rig: CameraRig
    pose: np.ndarray
    maps: np.ndarray
    roi: np.ndarray

    def poses(self, n: int) -> np.ndarray:
        """Return (n, D) float32 poses within a frame's motion of the true pose."""
        noise = np.random.default_rng(n).normal(size=(n, self.body.n_dof))
        poses = self.pose + noise * self.body.sigma
        return np.clip(poses, self.body.lower, self.body.upper).astype(np.float32)

    def on(self, device: Device) -> Observed:
        """Return the scene and its features on `device`."""
        maps, roi = device.to_device(self.maps), device.to_device(self.roi)
        return Observed(self.body, self.rig, self.pose, maps, roi)  # type: ignore[arg-type]


def register(commands: argparse._SubParsersAction) -> None:
    parser = add_command(
        commands, "objective", _run, help="the images' objective, Rymut's table 6.7"
    )
    add_timing_flags(parser)


def _run(args: argparse.Namespace) -> None:
    found, quick = places(), args.quick
    hypotheses, runs = (HYPOTHESES[::2], 5) if quick else (HYPOTHESES, 40)
    n_frames = _QUICK_FRAMES if quick else _FRAMES
    settings = {"hypotheses": hypotheses, "views": VIEWS, "runs": runs, "kind": "sp",
                "group_hypotheses": _GROUP_HYPOTHESES, "frames": n_frames}  # fmt: skip
    results = Results.begin("objective", args, settings)
    observed = make_observed(found[0], n_frames)
    first = observed[0]
    for place in found:
        results.plan(f"device {place.label}", partial(on_place, place, first, hypotheses, runs))
        by_both = partial(by_opencl_and_opengl, place, first, hypotheses, runs)
        results.plan(f"opengl {place.label}", by_both)
    for place in found:
        for cores in fewer_cores(place):
            measure = partial(apart, only_cores(cores), on_cpu, first, hypotheses, runs)
            results.plan(f"device {place.label}, {cores} used", measure, quick=False)
    for place in found:
        if place.cores is None:
            measure = partial(opencl_groups, place, observed)
            results.plan(f"groups {place.label}", measure, quick=False)
        measure = partial(opengl_groups, place, observed)
        results.plan(f"groups of OpenGL, {place.label}", measure, quick=False)
    results.plan("opengl, NumPy", partial(by_opengl, first, _TWIN_HYPOTHESES, 5))
    results.plan("numpy", partial(numpy_twin, first, _TWIN_HYPOTHESES))
    results.measure()
    print_report(results)


def make_observed(place: Place, n_frames: int) -> list[Observed]:
    """Return the features of the first frames of the walk in four cameras."""
    problem = make_problem(n_frames, "rymut31")
    scene, device = problem.scene.part(VIEWS), place.device()
    features = Features(device, scene.rig, scene.background)
    observed = []
    for frame in scene.frames:
        features(frame)
        maps, roi = features.maps.get(), features.roi.get()
        observed.append(Observed(problem.body, scene.rig, problem.pose, maps, roi))
    return observed


def numpy_twin(observed: Observed, n: int) -> dict[str, Any]:
    """Return the times, ms, of the twin for `n` hypotheses, by part."""
    poses = observed.poses(n)
    clock = [time.perf_counter()]
    cones = posed_cones(observed.body, poses)
    clock.append(time.perf_counter())
    pictures = draw_cones(observed.body, observed.rig, cones)
    clock.append(time.perf_counter())
    evaluate(observed, pictures)
    clock.append(time.perf_counter())
    ms = 1e3 * np.diff(clock)
    return {"label": "NumPy twin", "hypotheses": n,
            "matrices": ms[0], "rendering": ms[1], "objective": ms[2]}  # fmt: skip


def evaluate(observed: Observed, pictures: list[list[Picture]]) -> np.ndarray:
    """Evaluate the objective (N,) of images by view and hypothesis, by NumPy."""
    counts = count_pixels(pictures, observed.maps, observed.roi)
    areas = image_areas(observed.maps, observed.roi)
    return objective_values(counts, areas, ObjectiveConfig())


def by_opengl(observed: Observed, n: int, runs: int) -> dict[str, Any]:
    """Render by OpenGL, read back and count in NumPy; return ms by part for `n` hypotheses."""
    renderer = OpenGLRenderer(observed.body, observed.rig, n)
    with renderer:
        samples = [_by_opengl(renderer, observed) for _ in range(runs + 1)][1:]
    ms = {part: Timing(tuple(s[part] for s in samples)) for part in samples[0]}
    return {"label": f"OpenGL {_shorten_name(renderer.name)}, NumPy", "hypotheses": n, **ms}


def _by_opengl(renderer: OpenGLRenderer, observed: Observed) -> dict[str, float]:
    ms: dict[str, float] = {}
    views = len(observed.rig)
    (first, count), *more = renderer.batches()
    assert not more

    def measured(part: str, work: Callable[[], Any]) -> Any:
        started = time.perf_counter()
        result = work()
        renderer.context.finish()
        ms[part] = ms.get(part, 0.0) + 1e3 * (time.perf_counter() - started)
        return result

    poses = observed.poses(renderer.n_hypotheses)
    cones = measured("matrices", lambda: posed_cones(observed.body, poses))
    measured("upload", partial(renderer.upload, cones))
    measured("rendering", renderer.project)
    measured("rendering", partial(renderer.render, first, count))
    drawn = measured("download", partial(renderer.read, count))
    drawn = drawn.reshape(views, renderer.n_hypotheses, *drawn.shape[1:])
    pictures = [[(p[..., 0], p[..., 1] > 0) for p in by_view] for by_view in drawn]
    measured("objective", partial(evaluate, observed, pictures))
    return {**ms, "total": sum(ms.values())}


def _shorten_name(renderer: str) -> str:
    """Return a renderer's name without its versions."""
    return renderer.split(" (")[0].split("/")[0]


def by_opencl_and_opengl(
    place: Place, observed: Observed, hypotheses: tuple[int, ...], runs: int
) -> dict[str, Any]:
    """Measure bodies posed by OpenCL and all else by OpenGL, by the clock: its parts, each waited
    for, and the whole as the tracker runs it."""
    rows, name = [], ""
    for n in hypotheses:
        device = place.device()
        run, objective = opengl_evaluation(device, observed, n)
        whole = time_calls(run, runs, 3)
        poses = device.to_device(observed.poses(n))
        work = partial(opengl_parts, device, objective, poses)
        samples = _samples(work, runs + 2)[2:]
        parts = {part: Timing(tuple(s[part] for s in samples)) for part in samples[0]}
        sessions = len(list(objective.renderer.batches()))
        rows.append({"hypotheses": n, "parts": parts, "whole": whole, "sessions": sessions})
        name = _shorten_name(objective.renderer.name)
    return {"label": place.label, "renderer": name, "cores": place.cores, "rows": rows}


def opengl_evaluation(
    device: Device, observed: Observed, n: int, group: tuple[int, int] | None = None
) -> tuple[Callable[[], None], OpenGLObjective]:
    """Return a function that evaluates `n` hypotheses as the tracker does."""
    more = {} if group is None else {"group": group}
    scene = Scene(device, observed.rig, None, observed.body)
    objective = OpenGLObjective(scene, n, **more)
    objective.observe(observed.on(device))
    return _runner(device, objective, observed.poses(n)), objective


def opengl_parts(device: Device, objective: OpenGLObjective, poses: Array) -> dict[str, float]:
    """Return the times, ms, of the parts of one evaluation by OpenCL and OpenGL, and of all
    together."""
    ms = dict.fromkeys(("matrices", "upload", "rendering", "download", "objective"), 0.0)
    renderer, began = objective.renderer, time.perf_counter()

    def measured(part: str, work: Callable[[], Any], wait: Callable[[], None]) -> Any:
        started = time.perf_counter()
        result = work()
        wait()
        ms[part] += 1e3 * (time.perf_counter() - started)
        return result

    launches = objective.kinematics.launcher(poses)
    measured("matrices", lambda: [launch() for launch in launches], device.finish)
    cones = measured("upload", objective.kinematics.cones.get, device.finish)
    with renderer:
        finish = renderer.context.finish
        measured("upload", partial(objective.upload, cones), finish)
        measured("rendering", objective.project, finish)
        for first, count in renderer.batches():
            measured("rendering", partial(objective.draw, first, count), finish)
            measured("objective", partial(objective.count, first, count), finish)
        measured("objective", objective.score, finish)
        errors = measured("download", objective.read, finish)
    measured("download", partial(objective.errors.set, errors), device.finish)
    return {**ms, "total": 1e3 * (time.perf_counter() - began)}


def opencl_groups(place: Place, observed: list[Observed]) -> dict[str, Any]:
    """Return the times, ms, of an evaluation in every frame, by the rows of the counting
    work-groups."""
    rows = []
    for group in _OPENCL_GROUPS:
        run_on = partial(_evaluation, n=_GROUP_HYPOTHESES, rows=group)
        rows.append({"group": str(group), "frames": _time_frames(place, observed, run_on)})
    return {"label": place.label, "cores": place.cores, "rows": rows}


def opengl_groups(place: Place, observed: list[Observed]) -> dict[str, Any]:
    """Return the times by columns and rows of OpenGL's work-groups."""
    rows = []
    for group in _OPENGL_GROUPS:

        def run_on(device: Device, frame: Observed, group: Any = group) -> Callable[[], None]:
            return opengl_evaluation(device, frame, _GROUP_HYPOTHESES, group)[0]

        name = f"{group[0]} x {group[1]}"
        rows.append({"group": name, "frames": _time_frames(place, observed, run_on)})
    return {"label": place.label, "cores": place.cores, "rows": rows}


def _time_frames(
    place: Place, observed: list[Observed], run_on: Callable[..., Callable[[], None]]
) -> Timing:
    """Return the median of a few evaluations in each of the frames, one objective after the
    other."""
    device, frames = place.device(), iter(observed)
    return Timing(tuple(_samples(lambda: time_calls(run_on(device, next(frames)), 5, 1).median,
                                 len(observed))))  # fmt: skip


def _samples(work: Callable[[], Any], n: int) -> list[Any]:
    """Return the results of `n` calls, or of at least four if they take longer than `_ENOUGH`
    seconds."""
    began, found = time.monotonic(), []
    while len(found) < n and (len(found) < 4 or time.monotonic() - began < _ENOUGH):
        found.append(work())
    return found


def on_cpu(observed: Observed, hypotheses: tuple[int, ...], runs: int) -> dict[str, Any]:
    """Run `on_place` on this process's CPU."""
    return on_place(cpu_place(), observed, hypotheses, runs)


def on_place(
    place: Place, observed: Observed, hypotheses: tuple[int, ...], runs: int
) -> dict[str, Any]:
    """Measure one device: kernels by its events and their total by the clock, and the whole without
    events, with given poses."""
    rows = []
    for n in hypotheses:
        row: dict[str, Any] = {"hypotheses": n}
        row["whole"] = time_calls(_evaluation(place.device(), observed, n), runs, 3)
        device = place.device(profile=True)
        run = _evaluation(device, observed, n)
        assert device.profiler is not None
        time_calls(run, 2)
        device.profiler.clear()
        row["total"] = time_calls(run, runs, 0)
        ms = device.profiler.collect()
        row["kernels"] = {name: Timing(tuple(samples)) for name, samples in ms.items()}
        rows.append(row)
    return {"label": place.label, "cores": place.cores, "rows": rows}


def _evaluation(
    device: Device, observed: Observed, n: int, rows: int | None = None
) -> Callable[[], None]:
    """Return a function that evaluates `n` hypotheses and waits."""
    objective = ImageObjective(Scene(device, observed.rig, None, observed.body), n, rows=rows)
    objective.observe(observed.on(device))
    return _runner(device, objective, observed.poses(n))


def _runner(device: Device, objective: Likelihood, poses: np.ndarray) -> Callable[[], None]:
    """Return a function that evaluates `poses` and waits."""
    launches = objective.launcher(device.to_device(poses))
    device.finish()

    def run() -> None:
        for launch in launches:
            launch()
        device.finish()

    return run
