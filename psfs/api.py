"""What a user of the library calls first: open a sequence, reconstruct its voxel clouds."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cl import Device as Device
from cl import DeviceError as DeviceError
from cl import InputError as InputError
from cl import MissingFileError as MissingFileError
from cl import NumpyDevice as NumpyDevice
from cl import UserError as UserError
from cl import select_device as select_device
from psfs.backend import reconstructor_for
from psfs.common.ranges import check_kind, check_number
from psfs.diagnostics.camera_consistency import Suspect, suspects
from psfs.diagnostics.faults import Diagnosis, diagnosed
from psfs.footage.settings import Settings
from psfs.reconstructor import ReconstructionConfig
from psfs.sequence import Sequence
from psfs.volume import automatic_grid, volume_config
from psfs.voxels.bounding_volume import default_voxel_size
from psfs.voxels.clouds import without_debris
from psfs.voxels.grid import VoxelCloud, VoxelGrid
from psfs.voxels.limits import DEBRIS_SHARE, VOXEL_EDGES

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
    check_sequence(sequence, frames)
    check_kind("config", config, ReconstructionConfig)
    check_number("debris", debris, 0, 1)
    if voxel_size is not None:
        check_number("voxel_size, m,", voxel_size, *VOXEL_EDGES)
    volume = None if volume is None else Settings(volume=volume).volume
    device = chosen_device(device)
    sequence = trusted(sequence, device, all_cameras)
    if volume is None:
        grid = automatic_grid(sequence, frames, voxel_size, config, device)
    else:
        low, high = volume
        found = volume_config(sequence, config)
        size = voxel_size or default_voxel_size(sequence.rig, low, high, found)
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


def check_sequence(sequence: Sequence, frames: slice | None) -> None:
    """Raise InputError for a sequence that is not open, or frames that are no slice."""
    check_kind("sequence", sequence, Sequence, ": psfs.open_sequence(folder)", needed=True)
    check_kind("frames", frames, slice, ", such as slice(0, 100)")
    if frames is not None and frames.step is not None:
        check_number("the step of frames", frames.step, 1)


def trusted(
    sequence: Sequence, device: Device | NumpyDevice, all_cameras: bool = False
) -> Sequence:
    """Return the sequence as `examined` leaves it; log a warning for all that is wrong with it."""
    kept, diagnosis, left_out = examined(sequence, device, all_cameras)
    for text in remarks(diagnosis, left_out):
        log.warning("%s: %s", sequence.name, text)
    return kept


def examined(
    sequence: Sequence, device: Device | NumpyDevice, all_cameras: bool = False
) -> tuple[Sequence, Diagnosis, list[Suspect]]:
    """Return the sequence to work on, what is wrong with the footage, and the cameras left out.

    With `sync` "auto" cameras that come late are shifted. Cameras that disagree with the others are
    left out, see `psfs.diagnostics.camera_consistency.suspects`, unless `all_cameras` are wanted,
    the sequence was opened with `cameras`, or what is wrong is not a single camera.
    """
    diagnosis = diagnosed(sequence, device)
    if sequence.settings.sync == "auto":
        sequence = sequence.synchronised(diagnosis.late)
        diagnosis = diagnosis.without("late")
    if all_cameras or sequence.settings.cameras is not None or diagnosis.of_all:
        return sequence, diagnosis, []
    found = suspects(sequence, device=device, known=diagnosis.reasons)
    if found:
        named = {suspect.camera for suspect in found}
        sequence = sequence.with_cameras([n for n in sequence.rig.names if n not in named])
    return sequence, diagnosis, found


def synchronised(sequence: Sequence, device: Device | NumpyDevice) -> Sequence:
    """Return the sequence; with `sync` "auto", its late cameras shifted."""
    if sequence.settings.sync != "auto":
        return sequence
    return sequence.synchronised(diagnosed(sequence, device).late)


def remarks(diagnosis: Diagnosis, left_out: list[Suspect]) -> list[str]:
    """Return what to warn of: the cameras left out, and the other faults; one line each."""
    gone = {suspect.camera for suspect in left_out}
    rest = [str(f) for f in diagnosis.faults if f.serious and not gone & set(f.cameras)]
    return [*(f"left out: {suspect}" for suspect in left_out), *rest]


def chosen_device(device: Device | NumpyDevice | str | None) -> Device | NumpyDevice:
    """Return `device`, or the one of that name; None takes the fastest. Raises DeviceError."""
    check_kind("device", device, (Device, NumpyDevice, str))
    if device is None or isinstance(device, str):
        return select_device(device or "auto")
    return device
