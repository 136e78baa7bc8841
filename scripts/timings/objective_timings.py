"""`compare_timings.py objective`: one evaluation of the images' objective for all hypotheses.

The rows of Rymut 2016, table 6.7, for the NumPy twin, OpenGL with evaluation on the CPU, and OpenCL
on every device, on the synthetic walk: features of one frame, poses spread around the true one.
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
from apf.image_objective.opengl import OpenGLRenderer
from apf.reference.image_objective.objective import count_pixels, objective_values
from apf.reference.image_objective.render import Picture, draw_cones
from apf.scene import Scene
from cl import Device
from psfs.cameras.camera import CameraRig
from psfs.cli.commandline import add_command
from timings.measure import Place, Timing, apart, cpu_place, fewer_cores, only_cores, places, timed
from timings.results import Results, add_timing_flags
from timings.tables.objective import print_report
from timings.whole_frame import make_problem

#: The thesis's hypotheses and cameras.
HYPOTHESES, VIEWS = (96, 304, 512), 4
#: Hypotheses that the twin draws; its time is stated for all by their ratio.
_TWIN_HYPOTHESES = 8


@dataclass(frozen=True, eq=False)
class Observed:
    """What is compared: a body and its pose (D,), cameras, and a frame's features on the host."""

    body: BodyModel
    rig: CameraRig
    pose: np.ndarray
    maps: np.ndarray
    roi: np.ndarray

    def poses(self, n: int) -> np.ndarray:
        """(n, D) float32 within a frame's motion of the true pose."""
        noise = np.random.default_rng(n).normal(size=(n, self.body.n_dof))
        poses = self.pose + noise * self.body.sigma
        return np.clip(poses, self.body.lower, self.body.upper).astype(np.float32)

    def on(self, device: Device) -> Observed:
        """With the features on `device`."""
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
    settings = {"hypotheses": hypotheses, "views": VIEWS, "runs": runs, "kind": "sp"}
    results = Results.begin("objective", args, settings)
    observed = make_observed(found[0])
    results.section("numpy", partial(numpy_twin, observed, _TWIN_HYPOTHESES), quick=False)
    results.section("opengl", partial(by_opengl, observed, hypotheses, 5), quick=False)
    for place in found:
        for cores in fewer_cores(place):
            measure = partial(apart, only_cores(cores), on_cpu, observed, hypotheses, runs)
            results.section(f"device {place.label}, {cores} used", measure, quick=False)
        measure = partial(on_place, place, observed, hypotheses, runs)
        results.section(f"device {place.label}", measure)
    print_report(results)


def make_observed(place: Place) -> Observed:
    """Features of the first frame of the walk in four cameras."""
    problem = make_problem(6)
    scene, device = problem.scene.part(VIEWS), place.device()
    features = Features(device, scene.rig, scene.background)
    features(scene.frames[0])
    maps, roi = features.maps.get(), features.roi.get()
    return Observed(problem.body, scene.rig, problem.pose, maps, roi)


def numpy_twin(observed: Observed, n: int) -> dict[str, Any]:
    """ms of the twin for `n` hypotheses, by part."""
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
    """(N,) objective of pictures by view and hypothesis, by NumPy."""
    segments = (observed.maps[..., 0] > 127).astype(np.uint8)
    labels = np.zeros(len(observed.body.cones), int)
    counts = count_pixels(pictures, observed.maps, observed.roi, segments, labels)
    areas = segments.sum((1, 2))[:, None].astype(float)
    return objective_values(counts, areas, ObjectiveConfig())


def by_opengl(observed: Observed, hypotheses: tuple[int, ...], runs: int) -> dict[str, Any]:
    """Matrices and evaluation by NumPy, pictures by OpenGL; ms by part."""
    renderer = OpenGLRenderer(observed.body, observed.rig)
    rows = []
    for n in hypotheses:
        samples = [_by_opengl(renderer, observed, n) for _ in range(runs + 1)][1:]
        rows.append(
            {"hypotheses": n, "views_drawn": n * len(observed.rig)}
            | {part: Timing(tuple(s[part] for s in samples)) for part in samples[0]}
        )
    return {"label": f"OpenGL, {renderer.name.split(' (')[0]}", "rows": rows}


def _by_opengl(renderer: OpenGLRenderer, observed: Observed, n: int) -> dict[str, float]:
    ms = dict.fromkeys(("matrices", "upload", "rendering", "download", "objective"), 0.0)

    def measured(part: str, work: Callable[[], Any]) -> Any:
        started = time.perf_counter()
        result = work()
        renderer.finish()
        ms[part] += 1e3 * (time.perf_counter() - started)
        return result

    shapes = measured("matrices", lambda: renderer.shapes(observed.poses(n)))
    views = len(observed.rig)
    for first in range(0, n * views, renderer.n_tiles):
        count = measured("upload", partial(renderer.upload, shapes, first))
        measured("rendering", partial(renderer.render, count))
        drawn = measured("download", partial(renderer.read, count))
        pictures = [[(p[..., 0], p[..., 1] > 0) for p in drawn[v::views]] for v in range(views)]
        measured("objective", partial(evaluate, observed, pictures))
    return {**ms, "total": sum(ms.values())}


def on_cpu(observed: Observed, hypotheses: tuple[int, ...], runs: int) -> dict[str, Any]:
    """`on_place` of this process's CPU."""
    return on_place(cpu_place(), observed, hypotheses, runs)


def on_place(
    place: Place, observed: Observed, hypotheses: tuple[int, ...], runs: int
) -> dict[str, Any]:
    """One device: the kernels by its events, the whole by the clock, poses being there already."""
    rows = []
    for n in hypotheses:
        run, device = _evaluation(place.device(), observed, n)
        row: dict[str, Any] = {"hypotheses": n, "total": timed(run, runs, 3)}
        run, device = _evaluation(place.device(profile=True), observed, n)
        assert device.profiler is not None
        run()
        device.profiler.clear()
        for _ in range(runs):
            run()
        ms = device.profiler.collect()
        row["kernels"] = {name: Timing(tuple(samples)) for name, samples in ms.items()}
        rows.append(row)
    return {"label": place.label, "cores": place.cores, "rows": rows}


def _evaluation(device: Device, observed: Observed, n: int) -> tuple[Callable[[], None], Device]:
    """What evaluates `n` hypotheses and waits."""
    objective = ImageObjective(Scene(device, observed.rig, None, observed.body), n)
    objective.observe(observed.on(device))
    launches = objective.launcher(device.to_device(observed.poses(n)))
    device.finish()

    def run() -> None:
        for launch in launches:
            launch()
        device.finish()

    if device.profiler is not None:
        device.profiler.clear()
    return run, device
