"""The automatic start of a sequence's selected frames."""

from __future__ import annotations

import math
from collections.abc import Callable

from apf.body.model import BodyModel
from apf.filters.config import FilterConfig
from apf.initialisation.automatic import Start, find_start
from apf.initialisation.kept_voxels import stored
from apf.tracking.pipeline import at_rate
from cl import Device, NumpyDevice
from psfs.backend import reconstructor_for
from psfs.config import ReconstructionConfig
from psfs.sequence import Sequence
from psfs.voxels.grid import VoxelGrid

#: Frames that a start fits, the time, s, that they are spread over, and the most frames between two
#: of them that only lead from one to the next.
_FRAMES, _TIME, _BETWEEN = 10, 0.8, 2


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
) -> Start:
    """Find the person in the first of the selected frames of `sequence`; see `find_start`."""
    chosen = range(len(sequence))[selection or slice(None)]
    apart = _TIME / _FRAMES * sequence.fps / abs(chosen.step)
    skip = max(1, round(apart / (1 + _BETWEEN)))
    every = math.ceil(apart / skip)
    frames = chosen[: skip * ((_FRAMES - 1) * every + 1) : skip]
    reconstruct = reconstructor_for(device, sequence.rig, grid, sequence.background, reconstruction)
    voxels = [
        stored(device, reconstruct(frame))
        for frame in sequence.frames(slice(frames.start, frames.stop, frames.step))
    ]
    noise = at_rate(FilterConfig(), sequence.fps / frames.step).noise
    return find_start(
        device, voxels, sequence.rig, grid, template, noise, height, keep_shape, seed, progress,
        every,
    )  # fmt: skip
