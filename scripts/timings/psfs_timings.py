"""`compare_timings.py psfs`: the reconstruction against its NumPy twin and Open3D's carving."""

from __future__ import annotations

import argparse
import gc
from collections.abc import Callable
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from cl import NumpyDevice
from psfs.cli.commandline import add_command
from psfs.common.open3d import load_open3d
from psfs.reconstructor import Reconstructor
from psfs.reference.occupancy import occupancy
from psfs.reference.reconstructor import NumpyReconstructor, frame_evidence
from psfs.sequence import Frame
from timings.bench_scene import SHAPE, VIEWS, Scene, make_grid, playing, shared_scene
from timings.measure import (
    Place,
    Timing,
    apart,
    cpu_place,
    fewer_cores,
    measured_limits,
    only_cores,
    places,
    resident_megabytes,
    time_calls,
)
from timings.results import Results, add_timing_flags
from timings.stages import STAGES, find_stage, reconstruction_work
from timings.tables.psfs import print_report

#: Number of frames on a part of the cores, which take long.
_RUNS_ON_FEW = 6
#: Frames of one streamed run.
_STREAM = 16


def register(commands: argparse._SubParsersAction) -> None:
    parser = add_command(commands, "psfs", _run, help="voxel reconstruction, stage by stage")
    add_timing_flags(parser)


def _run(args: argparse.Namespace) -> None:
    found, quick = places(), args.quick
    runs, n_frames = (5, 6) if quick else (40, 16)
    results = Results.begin("psfs", args, {"views": VIEWS, "shape": SHAPE, "frames": n_frames})
    scene = shared_scene(n_frames)
    for place in found:
        results.plan(f"device {place.label}", partial(on_place, place, scene, runs))
    results.plan("open3d", lambda: open3d_carving(scene, 2 if quick else 10))
    results.plan("numpy", lambda: numpy_twin(scene, 3), quick=False)
    for place in found:
        for cores in fewer_cores(place):
            name = f"device {place.label}, {cores} used"
            results.plan(
                name, partial(on_cores, cores, scene, min(runs, _RUNS_ON_FEW)), quick=False
            )
    for place in found:
        results.plan(f"growth {place.label}", partial(growth, place, scene), quick=False)
    results.plan("memory", lambda: memory(found[0], scene, 1000), quick=False)
    results.measure()
    print_report(results)


def open3d_carving(scene: Scene, runs: int) -> dict[str, Any]:
    """Measure `VoxelGrid.carve_silhouette` with all cameras, on the same masks, grid and cameras.

    The dense grid to carve is made outside of the measured time.
    """
    open3d, grid, frame = load_open3d(), make_grid(), scene.frames[0]
    parameters, masks = [], []
    assert frame.masks is not None
    for camera, mask in zip(scene.rig, frame.masks, strict=True):
        pinhole = open3d.camera.PinholeCameraParameters()
        pinhole.intrinsic = open3d.camera.PinholeCameraIntrinsic(*camera.size, camera.K)
        extrinsic = np.eye(4)
        extrinsic[:3, :3], extrinsic[:3, 3] = camera.R, camera.t
        pinhole.extrinsic = extrinsic
        parameters.append(pinhole)
        masks.append(open3d.geometry.Image((mask / 255).astype(np.float32)))  # uint8 would fail
    left: list[int] = []
    ms = []
    for _ in range(runs + 1):
        nx, ny, nz = grid.shape
        sides = np.array(grid.shape) * grid.voxel_size
        voxels = open3d.geometry.VoxelGrid.create_dense(
            grid.origin, np.zeros(3), grid.voxel_size, *sides
        )

        def carve(voxels: Any = voxels) -> None:
            for mask, pinhole in zip(masks, parameters, strict=True):
                voxels.carve_silhouette(mask, pinhole, False)

        ms.append(time_calls(carve, 1, warm_up=0).median)
        left.append(len(voxels.get_voxels()))
    counts = {"voxels_left": left[0], "voxels_of_ours": hull_size(scene), "grid": (nx, ny, nz)}
    return {"carving": Timing(tuple(ms[1:])), "version": open3d.__version__, **counts}


def hull_size(scene: Scene) -> int:
    """Return the number of voxels whose centre lies in all masks that see it: the base of our
    test."""
    frame, grid = scene.frames[0], make_grid()
    assert frame.masks is not None
    centres, inside = grid.centres(), np.ones(grid.size, bool)
    for camera, mask in zip(scene.rig, frame.masks, strict=True):
        seen, row, column, _ = camera.look_up(centres)
        inside[seen] &= mask[row, column] > 0
    return int(inside.sum())


def numpy_twin(scene: Scene, runs: int) -> dict[str, Any]:
    """Measure the NumPy twin: a whole frame after the first, and its carving (occupancy) alone."""
    grid, frame, frames = make_grid(), scene.frames[0], playing(scene.frames)
    twin = NumpyReconstructor(NumpyDevice(), scene.rig, grid, scene.background)
    config = twin.config
    evidence = frame_evidence(frame, scene.rig, scene.background, config.silhouette)

    def carve() -> None:
        occupancy(scene.rig, grid, evidence, config.silhouette.evidence.step, config.occupancy)

    return {
        "whole": time_calls(lambda: twin(next(frames)), runs),
        "occupancy": time_calls(carve, runs, warm_up=0),
    }


def on_cores(cores: int, scene: Scene, runs: int) -> dict[str, Any]:
    """Run `on_place` on this machine's CPU with some of its cores, in a subprocess."""
    return apart(only_cores(cores), _on_cpu, scene, runs)


def _on_cpu(scene: Scene, runs: int) -> dict[str, Any]:
    return on_place(cpu_place(), scene, runs)


def on_place(place: Place, scene: Scene, runs: int) -> dict[str, Any]:
    """Measure one device: limits, stages by events, whole frames by the clock."""
    limits = measured_limits(place)
    rows: dict[str, Any] = {"label": place.label, "cores": place.cores, "limits": limits}
    for mode in ("dense", "sparse"):
        sparse = mode == "sparse"
        rows[mode] = {
            "stages": stages(place, scene, sparse, runs),
            **whole(place, scene, sparse, runs),
        }
        work = reconstruction_work(scene, make_grid(), rows[mode]["surface_voxels"])
        rows[mode]["limits_ms"] = {
            stage: limits.ms(*work[stage]) for stage in rows[mode]["stages"] if stage in work
        }
        gc.collect()
    return rows


def stages(place: Place, scene: Scene, sparse: bool, runs: int) -> dict[str, Timing]:
    """Measure the time by stage from the device's events, after a warm-up; colours included."""
    device = place.device(profile=True)
    profiler = device.profiler
    assert profiler is not None
    reconstructor = Reconstructor(device, scene.rig, make_grid(), scene.background, sparse=sparse)
    sums: dict[str, list[float]] = {}
    for run, frame in zip(range(runs + 3), playing(scene.frames), strict=False):
        reconstructor(frame).colours()
        ms = profiler.collect()
        profiler.clear()
        if run < 3:
            continue
        totals = dict.fromkeys(STAGES, 0.0)
        for name, values in ms.items():
            totals[find_stage(name)] += sum(values)
        for stage, total in totals.items():
            sums.setdefault(stage, []).append(total)
    return {stage: Timing(tuple(values)) for stage, values in sums.items() if max(values) > 0}


def whole(place: Place, scene: Scene, sparse: bool, runs: int) -> dict[str, Any]:
    """Measure whole frames by the clock, from images on the host to the surface on the device."""
    device = place.device()
    reconstructor = Reconstructor(device, scene.rig, make_grid(), scene.background, sparse=sparse)
    frames = playing(scene.pin(device))
    masked = Reconstructor(device, scene.rig, make_grid(), None, sparse=sparse)

    def one(what: Callable[[Frame], object]) -> Callable[[], None]:
        def run() -> None:
            what(next(frames))
            device.finish()

        return run

    def streamed() -> None:
        for voxels in reconstructor.stream(islice(frames, _STREAM)):
            voxels.colours()
        device.finish()

    result: dict[str, Any] = {
        "whole": time_calls(one(reconstructor), runs, 3),
        "whole_coloured": time_calls(one(lambda f: reconstructor(f).colours()), runs, 3),
        "masks": time_calls(one(masked), runs, 3),
        "cloud": time_calls(one(lambda f: reconstructor(f).cloud(colour=True)), runs, 3),
    }
    stream = time_calls(streamed, max(1, runs // 4))
    result["stream_per_frame"] = Timing(tuple(ms / _STREAM for ms in stream.samples))
    reconstructor(next(frames))
    result["surface_voxels"] = int(reconstructor.voxels.count.get()[0])
    return result


def growth(place: Place, scene: Scene) -> list[dict[str, Any]]:
    """Measure whole frames against voxels (dense and sparse) and against cameras, and 512^3
    sparse."""
    shapes = [(75, 75, 50), (110, 110, 74), SHAPE, (212, 212, 142), (300, 300, 200)]
    rows = []
    for sparse in (False, True):
        for shape in [*shapes, (512, 512, 512)] if sparse else shapes:
            rows.append(_measure_larger_grid(place, scene, shape, sparse))
        for views in (2, 4, 6):
            rows.append(_measure_larger_grid(place, scene.part(views), SHAPE, sparse))
    return rows


def _measure_larger_grid(
    place: Place, scene: Scene, shape: tuple[int, int, int], sparse: bool
) -> dict[str, Any]:
    device = place.device()
    grid = make_grid(shape)
    reconstructor = Reconstructor(device, scene.rig, grid, scene.background, sparse=sparse)
    frames = playing(scene.pin(device))

    def run() -> None:
        reconstructor(next(frames))
        device.finish()

    return {
        "label": place.label,
        "mode": "sparse" if sparse else "dense",
        "voxels": grid.size,
        "shape": shape,
        "views": len(scene.rig),
        "ms": time_calls(run, 15, 2),
    }


def memory(place: Place, scene: Scene, frames: int) -> dict[str, Any]:
    """Measure the resident memory after 50 streamed frames and after all, clouds and colours
    downloaded."""
    device = place.device()
    reconstructor = Reconstructor(device, scene.rig, make_grid(), scene.background, sparse=True)
    shown = islice(playing(scene.frames), frames)
    after: dict[int, float] = {}
    for done, voxels in enumerate(reconstructor.stream(shown), 1):
        voxels.cloud(colour=True)
        if done in (50, frames):
            gc.collect()
            after[done] = resident_megabytes()
    return {"frames": frames, "after_50_mb": after[50], "after_all_mb": after[frames]}
