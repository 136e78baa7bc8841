"""`compare_timings.py people`: a streamed frame of several people, by their number.

One reconstruction for all, its division, one annealed particle filter each. People walk on two
courses of `apf synth --people N`, before the cameras and in the settings of `whole`, in a room that
holds their courses.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.body.toml import load_body
from apf.filters.method import Method
from apf.initialisation.from_joints import fit_to_joints
from apf.timings.measure import Place, Timing, places
from apf.timings.scene import FPS, VIEWS, Scene, make_scene, playing, there_and_back
from apf.tracking.together import PeopleTracker
from cl import Device
from psfs.reconstructor import Reconstructor
from psfs.voxels.grid import VoxelGrid
from timings.grid import Grid, number
from timings.results import Results, add_command, add_timing_flags

#: Numbers of people, voxels of the room, and its least corner, m.
PEOPLE, SHAPE, _LOW = (1, 2, 3, 5), (220, 220, 100), np.array([-2.2, -2.2, 0.0])
_VOXEL = 0.02
#: Distinct frames, frames of a run, runs.
_DISTINCT, FRAMES, REPETITIONS = 20, 100, 3


@dataclass(frozen=True, eq=False)
class Crowd:
    """A scene of several people. bodies, poses (D,): of each, in the first frame."""

    scene: Scene
    bodies: list[BodyModel]
    poses: list[np.ndarray]

    def error_mm(self, place: int, found: list[np.ndarray]) -> np.ndarray:
        """Return each person's mean distance (P,), mm, of the joints to the truth of the frame
        played at `place`."""
        truth = self.scene.people_joints[:, there_and_back(place, len(self.scene.frames))]
        errors = []
        for body, pose, own in zip(self.bodies, found, truth, strict=True):
            mine = dict(zip(body.joint_names, posed_joints(body, pose[None])[0], strict=True))
            pairs = zip(self.scene.joint_names, own, strict=True)
            errors.append([np.linalg.norm(mine[name] - at) for name, at in pairs if name in mine])
        return 1e3 * np.array([np.mean(each) for each in errors])


def register(commands: argparse._SubParsersAction) -> None:
    parser = add_command(commands, "people", _run, help="a streamed frame of 1 to 5 people")
    add_timing_flags(parser)


def _run(args: argparse.Namespace) -> None:
    numbers, frames = (PEOPLE[:2], 4) if args.quick else (PEOPLE, FRAMES)
    repetitions = 1 if args.quick else REPETITIONS
    settings = {"views": VIEWS, "shape": SHAPE, "people": numbers, "frames": frames,
                "repetitions": repetitions}  # fmt: skip
    results = Results.begin("people", args, settings)
    distinct = 4 if args.quick else _DISTINCT
    for place in places():
        for n in numbers:
            measure = partial(measure_stream, place, n, distinct, frames, repetitions)
            results.plan(f"{n} people, {place.label}", measure)
    results.measure()
    for grid in tables(results):
        grid.show()


def make_crowd(device: Device, number: int, frames: int) -> Crowd:
    """Return `number` people with the bodies and the first poses of their true joints."""
    scene = make_scene(device, frames, number)
    bodies, poses = [], []
    for joints in scene.people_joints[:, 0]:
        first = dict(zip(scene.joint_names, joints, strict=True))
        body, pose, _ = fit_to_joints(load_body("song32"), first)
        bodies.append(body)
        poses.append(pose)
    return Crowd(scene, bodies, poses)


def measure_stream(
    place: Place, number: int, distinct: int, frames: int, repetitions: int
) -> dict[str, Any]:
    """Return ms from poses to poses of streamed runs, and of a frame after the other; the mean
    errors of the people; host time, ms, in which a frame is enqueued."""
    device = place.device()
    crowd = make_crowd(Device.best(), number, distinct)
    scene = crowd.scene
    held = scene.pin(device)
    grid = VoxelGrid(_LOW, _VOXEL, SHAPE)
    reconstruct = Reconstructor(device, scene.rig, grid, scene.background)
    method = Method()
    method = method.replace(filter=method.filter.scale_to_rate(FPS))
    people = PeopleTracker(device, scene.rig, reconstruct.voxels, crowd.bodies, method)
    runs, errors = [], np.zeros(0)
    for run in range(1 + repetitions):
        shown = islice(playing(held), (3 if run == 0 else frames) + 1)
        reconstruct.restart()
        people.start(crowd.poses)
        found, clock = [], []
        for estimates in people.stream(reconstruct.stream(shown)):
            found.append([estimate.pose for estimate in estimates])
            clock.append(time.perf_counter())
        if run > 0:
            runs.append(Timing(tuple(1e3 * np.diff(clock))))
            errors = np.mean([crowd.error_mm(k, poses) for k, poses in enumerate(found)], axis=0)
    return {"label": place.label, "people": number, "runs": runs, "errors_mm": errors}


def tables(results: Results) -> list[Grid]:
    """Return a table for each device: ms from poses to poses by the number of people."""
    devices: dict[str, list[Any]] = {}
    for section in results.sections.values():
        devices.setdefault(section["label"], []).append(section)
    return [_table(label, rows) for label, rows in devices.items()]


def _table(label: str, rows: list[Any]) -> Grid:
    first = rows[0]
    cells = []
    for row in rows:
        ms = min(run.median for run in row["runs"])
        further = row["people"] - first["people"]
        each = (ms - min(run.median for run in first["runs"])) / further if further else 0.0
        errors = ", ".join(f"{error:.1f}" for error in row["errors_mm"])
        runs = ", ".join(str(run) for run in row["runs"])
        cells.append([str(row["people"]), runs, number(each) if further else "", errors])
    return Grid(
        f"A streamed frame, {label}",
        ["people", "ms of each run", "ms for each further one", "errors, mm"],
        cells,
    )
