"""The pipeline stage of a device's command, and the least work of each stage."""

from __future__ import annotations

import re
from functools import cache
from importlib import resources
from itertools import islice
from pathlib import Path

import numpy as np

from apf.body.model import BodyModel
from apf.filters.config import FilterConfig
from apf.likelihood.voxel import choose_cone_sampling
from apf.timings.measure import Timing
from apf.timings.scene import WholeFrame, playing
from cl import Device
from psfs.cameras.camera import CameraRig
from psfs.voxels.grid import VoxelGrid

#: Stages in the order of the pipeline, with their part of Song et al.'s algorithm.
PARTS = {
    # Smoothing has been a part of the occupancy since 2026-11-28; the results are of before.
    "reconstruction": ("upload", "silhouette", "occupancy", "smoothing", "surface", "learning"),
    "colour": ("colour",),
    "tracking": ("reprojection", "kinematics", "likelihood", "annealing", "refinement"),
    "other": ("download", "other"),
}
STAGES = tuple(stage for stages in PARTS.values() for stage in stages)
#: Stages by kernel file, if the names differ; by command if it belongs to another stage than its
#: file.
_OF_FILE = {
    "floor_light": "silhouette",
    "light": "silhouette",
    "tiles": "occupancy",
    "pool": "occupancy",
    "appearance": "learning",
    "surface_samples": "likelihood",
    "limb_search": "refinement",
}
_OF_COMMAND = {
    "upload": "upload",
    "copy": "upload",
    "download": "download",
}
#: Floating-point operations: per pixel of a silhouette; per projection of a point by a camera
#: without distortion, the look-up included; per voxel of the smoothing; per sample inside a
#: projected cone; per distance of a point to a cone; per bone posed; per normal random number.
_PIXEL, _PROJECTION, _MEAN, _SAMPLE, _DISTANCE, _BONE, _NORMAL = 60, 30, 27, 20, 30, 120, 60


@cache
def _file_of_kernel() -> dict[str, str]:
    """Return the file, without suffix, of each kernel."""
    found = {}
    for file in Path(str(resources.files("cl") / "kernels")).rglob("*.cl"):
        for name in re.findall(r"__kernel[^{;]*?\bvoid\s+(\w+)\s*\(", file.read_text()):
            found[name] = file.stem
    return found


def find_stage(command: str) -> str:
    """Return the stage of a profiled command: a kernel, a copy, a fill."""
    if command in _OF_COMMAND:
        return _OF_COMMAND[command]
    file = _file_of_kernel().get(command, "other")
    stage = _OF_FILE.get(file, file)
    return stage if stage in STAGES else "other"


Work = dict[str, tuple[float, float]]


def reconstruction_work(rig: CameraRig, grid: VoxelGrid, surface: int) -> Work:
    """Return (bytes, operations) of each stage without optimisations: every byte of
    input and output once, every voxel projected into every camera. A stage that is faster than its
    limit avoids some of this work. surface: number of surface voxels."""
    views, pixels, voxels = len(rig), _pixels(rig), grid.size
    padded = float(np.prod([n + 2 for n in grid.shape]))
    return {
        "upload": (3 * pixels, 0),
        "silhouette": ((3 + 32 + 3) * pixels, _PIXEL * pixels),
        "occupancy": (pixels + 4 * voxels, _PROJECTION * padded * views + _MEAN * voxels),
        "surface": (4 * voxels + voxels / 4 + 4 * surface, 2 * voxels),
        "colour": (8 * pixels + 16 * surface, 2 * _PROJECTION * surface * views),
    }


def tracking_work(rig: CameraRig, body: BodyModel, config: FilterConfig, surface: int) -> Work:
    """Return (bytes, operations) of each stage of tracking, likewise; all layers of a frame
    together.

    Scoring a pose: bones posed, four corners of every cone projected, all samples of all cones
    looked up in all cameras, every surface sample compared with every cone.
    """
    views, pixels = len(rig), _pixels(rig)
    cones, dof = len(body.cones), body.n_dof
    search, likelihood = config.search, config.likelihood
    points = likelihood.n_points / likelihood.point_turns  # points per layer
    scored = search.n_particles * search.n_layers
    sampling = choose_cone_sampling(body)
    samples = float(np.sum([r * (c + 2) for r, c in sampling]))
    pose = float(_BONE * len(body.bones)) + 4 * _PROJECTION * cones * views
    pose += _SAMPLE * samples * views + _DISTANCE * cones * points
    step = float(likelihood.n_points) * (_DISTANCE * cones + 12 * dof + dof * dof)
    read = search.n_layers * (2 * pixels + 16 * points) + 4 * dof * scored
    return {
        "reprojection": (4 * surface + 2 * pixels, _PROJECTION * surface * views),
        "likelihood": (read, pose * scored),
        "annealing": (3 * 4 * dof * scored, _NORMAL * dof * scored),
        "refinement": (16 * likelihood.n_points, (config.refinement.steps + 1) * step),
    }


def _pixels(rig: CameraRig) -> int:
    return len(rig) * rig.width * rig.height


def stage_times(whole: WholeFrame, frames: int, warm_up: int = 2) -> dict[str, Timing]:
    """Return the time, ms per frame, of every stage from the events of a profiled device."""
    assert isinstance(whole.device, Device)
    profiler = whole.device.profiler
    assert profiler is not None
    sums: dict[str, list[float]] = {}
    for run, frame in enumerate(islice(playing(whole.problem.scene.frames), frames + warm_up)):
        whole(frame)
        totals = dict.fromkeys(STAGES, 0.0)
        for name, values in profiler.collect().items():
            totals[find_stage(name)] += sum(values)
        profiler.clear()
        if run >= warm_up:
            for stage, total in totals.items():
                sums.setdefault(stage, []).append(total)
    return {stage: Timing(tuple(ms)) for stage, ms in sums.items() if max(ms) > 0}
