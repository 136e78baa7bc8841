"""`compare_timings.py whole`: Song et al.'s whole algorithm in the columns of their tables 2 to 4.

Reconstruction, colour and tracking, from pictures in host memory to pose and coloured voxels in
host memory, in NumPy on one thread, in OpenCL on one core and on all cores of the CPU, and on every
GPU: the same settings, frames and random numbers in each. All of it by the defaults, and in OpenCL
by `--preset song` as well, which is what the paper describes and nothing else.
"""

from __future__ import annotations

import argparse
from functools import partial
from typing import Any

import cv2
import numpy as np

from apf.body.kinematics import posed_points
from apf.body.model import Joint
from apf.filters.term_weights import KEYPOINTS_ON
from apf.initialisation.from_joints import fit_to_joints
from apf.keypoints.landmarks import locate_points
from apf.likelihood.keypoint_model import KeypointModel
from apf.likelihood.observations import PointObservations
from cl import NumpyDevice
from psfs.cli.commandline import add_command
from timings.measure import (
    Place,
    apart,
    cpu_place,
    fewer_cores,
    measured_limits,
    only_cores,
    places,
)
from timings.results import Results, add_timing_flags
from timings.scene import (
    SHAPE,
    VIEWS,
    Problem,
    Sightings,
    WholeFrame,
    make_grid,
    make_problem,
    sequence_run,
    songs_own,
    stage_times,
    stream_run,
    there_and_back,
)
from timings.stages import reconstruction_work, tracking_work
from timings.whole_tables import tables

#: Song et al.: frames of a run, and runs.
FRAMES, REPETITIONS = 200, 3
#: Frames of a streamed run with or without a cue.
_STREAMED = 100
#: Frames of a NumPy run: the twins take seconds for each.
_NUMPY_FRAMES = 5
#: Distinct frames of the walk, played there and back.
_SCENE_FRAMES, _QUICK_SCENE_FRAMES = 40, 6
#: Environment that limits the libraries below NumPy to one thread.
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


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
    work = reconstruction_work(problem.scene.rig, make_grid(problem.shape), surface)
    work |= tracking_work(problem.scene.rig, problem.body, problem.config, surface)
    return {"label": place.label, "limits": limits, "stages": stages, "work": work}


#: The 17 keypoints of COCO, which most pose networks detect.
COCO = ("nose", *(f"{side}_{part}" for part in (
    "eye", "ear", "shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    for side in ("left", "right")))  # fmt: skip
#: Standard deviation, px, of each of their coordinates.
_ERROR = 3.0
_WITHOUT_CONTOUR, _WITHOUT_COLOUR = {"contour_weight": 0.0}, {"part_colour_weight": 0.0}
#: The changed settings of each variant.
VARIANTS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "without contours": _WITHOUT_CONTOUR,
    "without colours of parts": _WITHOUT_COLOUR,
    "without both": {**_WITHOUT_CONTOUR, **_WITHOUT_COLOUR},
    "with 17 keypoints in each camera": KEYPOINTS_ON,
}


def streamed_cues(
    place: Place, problem: Problem, frames: int, repetitions: int, seconds: float
) -> dict[str, Any]:
    """Return a row per variant: ms from pose to pose of `repetitions` streamed runs of `frames`,
    each of at most `seconds`, the variants in turn; the runs' mean error."""
    device = place.device()
    held = problem.scene.pin(device)
    seen = make_sightings(problem)
    wholes = {}
    for name, changes in VARIANTS.items():
        whole = WholeFrame(device, problem.smaller(**changes))
        wholes[name] = whole, seen if changes is KEYPOINTS_ON else None
    runs: dict[str, list[Any]] = {name: [] for name in wholes}
    for whole, sightings in wholes.values():
        stream_run(whole, held, 3, sightings=sightings)
    for _ in range(repetitions):
        for name, (whole, sightings) in wholes.items():
            runs[name].append(stream_run(whole, held, frames, seconds, sightings=sightings))
    rows = [
        {
            "variant": name,
            "runs": [run["frames"] for run in of],
            "error_mm": float(np.mean([run["error_mm"] for run in of])),
        }
        for name, of in runs.items()
    ]
    return {"label": place.label, "cores": place.cores, "rows": rows}


def make_sightings(problem: Problem) -> Sightings:
    """Return a function that gives the keypoints in all cameras of the frame played at a place: the
    true joints with noise."""
    points = locate_points(problem.body, COCO)
    n_points = len(points)
    own = np.arange(n_points)
    one = np.ones(n_points)
    model = KeypointModel(
        columns=points.columns, bone=points.bones, position=points.offsets,
        partner=np.where(points.partners == own, -1, points.partners),
        confidence=np.array([0.0, 1.0]), error=np.full(2, _ERROR), factor=one,
    )  # fmt: skip
    random = np.random.default_rng(0)
    seen = [_observe(problem, joints, random) for joints in problem.scene.joints]

    def sightings(place: int) -> PointObservations:
        return model.observations(seen[there_and_back(place, len(seen))])

    return sightings


def _observe(problem: Problem, joints: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return keypoints (V, K, 3) of one frame: px and confidence."""
    named = dict(zip(problem.scene.joint_names, joints, strict=True))
    body, pose, _ = fit_to_joints(problem.body, named)
    points = locate_points(body, COCO)
    fixed = [Joint(*of) for of in zip(points.names, points.bones, points.offsets, strict=True)]
    world = posed_points(body, pose[None], fixed)[0]
    seen = np.full((len(problem.scene.rig), len(COCO), 3), np.nan)
    for view, camera in zip(seen, problem.scene.rig, strict=True):
        pixels, _ = camera.project(world)
        view[points.columns, :2] = pixels + random.normal(scale=_ERROR, size=pixels.shape)
        view[points.columns, 2] = 1.0
    return seen
