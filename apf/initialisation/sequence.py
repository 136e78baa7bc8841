"""The automatic start of a sequence's selected frames."""

from __future__ import annotations

import math
from collections.abc import Callable

from apf.body.model import BodyModel
from apf.filters.config import FilterConfig
from apf.initialisation.automatic import find_start
from apf.initialisation.config import FrameChoice, StartConfig
from apf.initialisation.kept_voxels import stored
from apf.initialisation.start import Start, check_startable
from apf.scene import Scene
from cl import Device, InputError, NumpyDevice
from psfs.backend import reconstructor_for
from psfs.reconstructor import ReconstructionConfig
from psfs.sequence import Sequence
from psfs.voxels.grid import VoxelGrid

#: Frames per second from which on a person can be followed.
SLOWEST = 1.0


def start_of(
    device: Device | NumpyDevice,
    sequence: Sequence,
    grid: VoxelGrid,
    template: BodyModel,
    selection: slice | None = None,
    reconstruction: ReconstructionConfig | None = None,
    height: float | None = None,
    keep_shape: bool = False,
    seed: int = 0,
    progress: Callable[[], object] | None = None,
    config: StartConfig | None = None,
) -> Start:
    """Find the person in the first of the selected frames of `sequence`; see `find_start`."""
    config = config or StartConfig()
    check_startable(template)  # before the voxels are made
    chosen = range(len(sequence))[selection or slice(None)]
    check_rate(sequence, chosen.step)
    frames, every = frames_to_fit(chosen, sequence.fps, config.frames)
    reconstruct = reconstructor_for(device, sequence.rig, grid, sequence.background, reconstruction)
    voxels = [
        stored(device, reconstruct(frame))
        for frame in sequence.frames(slice(frames.start, frames.stop, frames.step))
    ]
    noise = FilterConfig().at_rate(sequence.fps / frames.step).search.noise
    scene = Scene(device, sequence.rig, grid, template)
    return find_start(scene, voxels, noise, height, keep_shape, seed, progress, every, config)


def check_rate(sequence: Sequence, step: int) -> None:
    """Raise InputError if every `step`-th frame of a sequence is too seldom to follow somebody."""
    fps = sequence.fps / abs(step)
    if fps < SLOWEST:
        raise InputError(
            f"{sequence.name}: {fps:g} frames per second to be tracked; expected at least "
            f"{SLOWEST:g}: people move too far in between"
        )


def frames_to_fit(chosen: range, fps: float, config: FrameChoice) -> tuple[range, int]:
    """Return the first of the chosen frames of a sequence that a start reconstructs, and every
    how many-th of them it fits the body to."""
    apart = config.duration / config.n_fitted * fps / abs(chosen.step)
    skip = max(1, round(apart / (1 + config.n_between)))
    every = math.ceil(apart / skip)
    return chosen[: skip * ((config.n_fitted - 1) * every + 1) : skip], every
