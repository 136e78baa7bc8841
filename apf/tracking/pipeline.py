"""From a sequence to a track: reconstruct and track frame by frame."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np

from apf.backend import device_tracker, observer_for, shares_launches, tracker_for
from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.filters.base import Estimate
from apf.filters.config import SIGMA_FPS, FilterConfig
from apf.filters.method import Method
from apf.scene import Scene
from apf.tracking.recovery import SeparateRuns, Watched, WatchedRuns
from apf.tracking.track import Track
from apf.tracking.uncertainty import joint_covariance
from cl import Device, InputError, NumpyDevice
from psfs.cameras.camera import CameraRig
from psfs.config import ReconstructionConfig
from psfs.reconstructor import Reconstructor
from psfs.sequence import Frame, Sequence
from psfs.voxels.grid import VoxelGrid

#: The search for a lost person: so much more noise, so many times the layers.
_WIDER, _LONGER = 4.0, 2


def track_sequence(
    device: Device | NumpyDevice,
    sequence: Sequence,
    grid: VoxelGrid | None,
    body: BodyModel,
    pose: np.ndarray,
    method: Method | None = None,
    reconstruction: ReconstructionConfig | None = None,
    selection: slice | None = None,
    progress: Callable[[], object] | None = None,
) -> Track:
    """Track `body` from `pose` (D,) through the selected frames of `sequence`.

    `grid` may be None where the method does without voxels, which then are not reconstructed.
    The noise grows with the time between frames, see `BodyModel.sigma`. `progress` is called
    after each frame; a KeyboardInterrupt ends the track after the last whole frame (and is raised
    again if there is none).
    """
    method = method or Method()
    seeds = [method.filter.seed]
    return track_seeds(
        device, sequence, grid, body, pose, method, seeds, reconstruction, selection, progress
    )[0]


def track_seeds(
    device: Device | NumpyDevice,
    sequence: Sequence,
    grid: VoxelGrid | None,
    body: BodyModel,
    pose: np.ndarray,
    method: Method,
    seeds: list[int],
    reconstruction: ReconstructionConfig | None = None,
    selection: slice | None = None,
    progress: Callable[[], object] | None = None,
) -> list[Track]:
    """As `track_sequence`, one track for each of `seeds` from a single reconstruction."""
    step = (selection.step or 1) if selection else 1
    observe = observer_for(device, sequence, grid, method, reconstruction)
    scaled = replace(method, filter=at_rate(method.filter, sequence.fps / step))
    tracker = watched_runs(device, body, sequence.rig, grid, scaled, seeds)
    seen = observed(observe, sequence.frames(selection))
    frames, estimates = track_voxels(tracker, pose, seen, progress)
    made_by: dict[str, Any] = {
        "sequence": str(sequence.folder),
        "device": device.name,
        "version": version("psfs-apf"),
    }
    if grid is not None and method.uses_voxels:
        made_by["grid"] = {
            "origin": grid.origin.tolist(),
            "voxel_size": grid.voxel_size,
            "shape": list(grid.shape),
        }
    return [
        track_of(body, sequence.fps, frames, list(run), {**made_by, **of.described()})
        for of, run in zip(seeded(method, seeds), zip(*estimates, strict=True), strict=True)
    ]


def seeded(method: Method, seeds: list[int]) -> list[Method]:
    """`method` with each of `seeds`. Raises InputError for impossible ones."""
    return [replace(method, filter=replace(method.filter, seed=seed)) for seed in seeds]


def watched_runs(
    device: Device | NumpyDevice,
    body: BodyModel,
    rig: CameraRig,
    grid: VoxelGrid | None,
    method: Method,
    seeds: list[int],
) -> WatchedRuns | SeparateRuns:
    """The watched trackers of `method` with each of `seeds`, as one where the method can."""
    methods = seeded(method, seeds)
    if len(seeds) == 1 or not shares_launches(device, method):
        return SeparateRuns([watched(device, body, rig, grid, of) for of in methods])

    scene = Scene(device, rig, grid, body)

    def watch(run: int, restart: Any) -> Watched:
        return watched(device, body, rig, grid, methods[run], restart)

    return WatchedRuns(device_tracker(scene, method, seeds), len(seeds), watch)


def observed(observe: Callable[[Frame], Any], frames: Iterable[Frame]) -> Iterator[tuple[int, Any]]:
    """Number and observation of every frame; where `observe` can stream, it is ahead of them. A
    KeyboardInterrupt while the next frame is read is raised after the frame before it."""
    interrupts: list[KeyboardInterrupt] = []

    def uninterrupted() -> Iterator[Frame]:
        try:
            yield from frames
        except KeyboardInterrupt as interrupt:
            interrupts.append(interrupt)

    if isinstance(observe, Reconstructor):
        for voxels in observe.stream(uninterrupted()):
            assert voxels.frame is not None
            yield voxels.frame.index, voxels
        if interrupts:
            raise interrupts[0]
    else:
        for frame in frames:
            yield frame.index, observe(frame)


def watched(
    device: Device | NumpyDevice,
    body: BodyModel,
    rig: CameraRig,
    grid: VoxelGrid | None,
    method: Method,
    tracker: Any = None,
) -> Watched:
    """The tracker of `method` that knows when it has lost the person, see `recovery`; or `tracker`,
    which searches by that method."""
    scene, search = Scene(device, rig, grid, body), method.filter
    longer = {} if method.search == "sir" else {"n_layers": _LONGER * search.n_layers}
    wider = replace(search, noise=_WIDER * search.noise, **longer)

    def wide() -> Any:
        return tracker_for(scene, replace(method, filter=wider))

    def everywhere(voxels: Any) -> list[np.ndarray]:
        from apf.initialisation.automatic import find_start  # which tracks, too
        from apf.initialisation.kept_voxels import stored

        assert grid is not None, "voxels have a grid"
        seen = [stored(device, voxels)]
        try:
            found = find_start(
                device, seen, rig, grid, body, search.noise, keep_shape=True, seed=search.seed,
                attempts=1,
            )  # fmt: skip
        except InputError:
            return []  # nobody is there
        return [found.pose]

    tracker = tracker or tracker_for(scene, method)
    return Watched(tracker, wide, everywhere if method.uses_voxels else None)


def at_rate(config: FilterConfig, fps: float) -> FilterConfig:
    """`config` with the noise that `fps` frames per second need, and smoothness that bears it."""
    longer = SIGMA_FPS / fps
    return replace(
        config, noise=config.noise * longer, smoothness_scale=config.smoothness_scale * longer
    )


def track_voxels(
    tracker: Any,
    pose: np.ndarray,
    voxels: Iterable[tuple[int, Any]],
    progress: Callable[[], object] | None = None,
) -> tuple[list[int], list[Any]]:
    """Frame numbers and what `step` returned of a tracker, or of runs, that start at `pose` (D,)
    and are shown `voxels`.

    A KeyboardInterrupt ends the track after the last whole frame; it is raised again if there is
    none.
    """
    tracker.start(pose)
    frames: list[int] = []
    estimates: list[Any] = []
    try:
        for index, shown in voxels:
            estimate = tracker.step(shown)
            frames.append(index)
            estimates.append(estimate)
            if progress is not None:
                progress()
    except KeyboardInterrupt:
        if not estimates:
            raise
        frames = frames[: len(estimates)]
    return frames, estimates


def track_of(
    body: BodyModel,
    fps: float,
    frames: list[int],
    estimates: list[Estimate],
    made_by: dict[str, Any],
) -> Track:
    """The track of these estimates, one per frame; made_by: what its `config` tells as JSON."""

    def stacked(name: str) -> np.ndarray:
        return np.stack([getattr(estimate, name) for estimate in estimates])

    poses = stacked("pose")
    told = ("ess", "beta", "deviation", "misfit", "confidence", "lost", "restart")
    diagnostics: dict[str, Any] = {name: stacked(name) for name in told}
    # The log weight of the best particle at exponent 1, Song et al. eq. (16).
    diagnostics["best_log_weight"] = -stacked("least_error")
    covariance = joint_covariance(body, poses, stacked("information"), stacked("deviation"))
    diagnostics["covariance"] = np.where(
        diagnostics["lost"][:, None, None, None], np.nan, covariance
    )
    return Track(
        body_name=body.name,
        dof_names=body.dof_names,
        joint_names=tuple(body.joint_names),
        fps=fps,
        frames=np.array(frames),
        poses=poses,
        joints=posed_joints(body, poses),
        edges=np.array(body.edges),
        diagnostics=diagnostics,
        config=json.dumps(made_by),
    )
