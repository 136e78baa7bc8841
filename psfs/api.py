"""What a user of the library calls first: open a sequence, reconstruct its voxel clouds."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cl import Device, NumpyDevice, select_device
from psfs.backend import reconstructor_for
from psfs.diagnostics.camera_consistency import Suspect, suspects
from psfs.reconstructor import ReconstructionConfig
from psfs.sequence import Sequence
from psfs.volume import automatic_grid
from psfs.voxels.bounding_volume import default_voxel_size
from psfs.voxels.clouds import DEBRIS_SHARE, without_debris
from psfs.voxels.grid import VoxelCloud, VoxelGrid

log = logging.getLogger(__name__)


def open_sequence(folder: str | Path, **settings: Any) -> Sequence:
    """Open the calibrated, synchronised views in `folder`.

    settings: the keys of `sequence.toml`, see `psfs.footage.settings.Settings`; they win over the
    file, which wins over what the folder's layout says. Raises InputError for whatever does not fit
    together, MissingFileError for what is not there.
    """
    return Sequence.open(folder, **settings)


def reconstruct(
    sequence: Sequence,
    *,
    device: Device | NumpyDevice | str | None = None,
    frames: slice | None = None,
    voxel_size: float | None = None,
    volume: tuple[np.ndarray, np.ndarray] | None = None,
    colour: bool = True,
    sparse: bool = True,
    debris: float = DEBRIS_SHARE,
    all_cameras: bool = False,
    config: ReconstructionConfig | None = None,
) -> Iterator[VoxelCloud]:
    """Reconstruct the chosen frames of `sequence`, as `psfs reconstruct` does: Song et al. 2.1-2.2.

    Yields the cloud of one frame after the other, in host memory, the caller's to keep.

    device: where to compute, or its name as of `cl.select_device`; by default the fastest one.
    frames: those to reconstruct, all by default. voxel_size: edge of a voxel, m; by default 2 cm
    for people. volume: lowest and highest corner (3,) m of what is reconstructed; by default the
    sequence's, or found, see `automatic_grid`. colour: give the clouds the pictures' colours, where
    there are pictures. sparse: work only on bricks of voxels that can be occupied, for the same
    voxels in less time and memory. debris: connected parts smaller than this share of the largest
    are dropped, see `without_debris`. all_cameras: keep those that disagree with the others; by
    default they are left out, with a warning in the log, see `trusted`. config: of silhouettes and
    occupancy. Raises InputError where nothing stands out from the background, DeviceError where the
    device cannot be used.
    """
    device = chosen_device(device)
    if not all_cameras:
        sequence = trusted(sequence, device)
    if volume is None:
        grid = automatic_grid(sequence, frames, voxel_size, config, device)
    else:
        low, high = np.asarray(volume, np.float64)
        size = voxel_size or default_voxel_size(sequence.rig, low, high)
        grid = VoxelGrid.covering(low, high, size)
    reconstructor = reconstructor_for(
        device, sequence.rig, grid, sequence.background, config, sparse=sparse
    )

    def clouds() -> Iterator[VoxelCloud]:
        for frame in sequence.frames(frames):
            voxels = reconstructor(frame)
            cloud = voxels.cloud(colour=colour and frame.images is not None)
            yield without_debris(cloud, debris)

    return clouds()


def trusted(sequence: Sequence, device: Device | NumpyDevice) -> Sequence:
    """Return `consistent_cameras` of the sequence; log a warning for each that is left out.

    A sequence that was opened with `cameras` keeps those.
    """
    if sequence.settings.cameras is not None:
        return sequence
    kept, left_out = consistent_cameras(sequence, device)
    for suspect in left_out:
        log.warning("%s: left out: %s", sequence.name, suspect)
    return kept


def consistent_cameras(
    sequence: Sequence, device: Device | NumpyDevice
) -> tuple[Sequence, list[Suspect]]:
    """Return the sequence without the cameras that disagree with the others, and those.

    See `psfs.diagnostics.camera_consistency.suspects`.
    """
    found = suspects(sequence, device=device)
    if not found:
        return sequence, []
    named = {suspect.camera for suspect in found}
    return sequence.with_cameras([n for n in sequence.rig.names if n not in named]), found


def chosen_device(device: Device | NumpyDevice | str | None) -> Device | NumpyDevice:
    """Return `device`, or the one of that name; None takes the fastest. Raises DeviceError."""
    if device is None or isinstance(device, str):
        return select_device(device or "auto")
    return device
