"""The library's main functions: open a sequence, reconstruct its voxel clouds."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cl import Device as Device
from cl import DeviceError as DeviceError
from cl import InputError as InputError
from cl import MissingFileError as MissingFileError
from cl import NumpyDevice as NumpyDevice
from cl import UserError as UserError
from cl import select_device as select_device
from psfs.common.ranges import check_kind, check_number
from psfs.footage.settings import SequenceSettings
from psfs.opening import prepare_reconstruction
from psfs.request import ReconstructRequest
from psfs.sequence import Sequence
from psfs.volume import Volume
from psfs.voxels.body_prior import TrackedBody
from psfs.voxels.clouds import remove_debris
from psfs.voxels.config import DEBRIS_SHARE, VOXEL_EDGES, ReconstructionConfig
from psfs.voxels.grid import VoxelCloud

log = logging.getLogger(__name__)


def open_sequence(folder: str | Path, **settings: object) -> Sequence:
    """Open the calibrated, synchronised views in `folder`.

    settings: the keys of `sequence.toml`, see `psfs.footage.settings.SequenceSettings`; they win
    over the file, which wins over what the folder's layout says. Raises InputError if settings,
    files and calibration do not fit together, MissingFileError for a missing file.
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
    debris: float = DEBRIS_SHARE,
    all_cameras: bool = False,
    config: ReconstructionConfig | None = None,
    track: str | Path | None = None,
) -> Iterator[VoxelCloud]:
    """Reconstruct the chosen frames of `sequence`, as `psfs reconstruct` does: Song et al. 2.1-2.2.

    Yields the clouds frame by frame, in host memory; they belong to the caller.

    device: the device that computes, or its name for `cl.select_device`; by default the fastest
    one. frames: those to reconstruct, all by default. voxel_size: edge of a voxel, m; by default 2
    cm for people. volume: lowest and highest corner (3,) m of the reconstructed box; by default the
    sequence's, or found around everybody. colour: give the clouds the pictures' colours, if there
    are pictures. debris: connected parts smaller than this share of the largest
    are dropped, see `remove_debris`. all_cameras: keep cameras that disagree with the others; by
    default they are left out, with a warning in the log, see `examine`. config: settings of
    silhouettes and occupancy. track: folder of `apf track`, or its npz: the tracked body is a prior
    of the voxels, see `psfs.voxels.body_prior`. Raises InputError if nothing stands out from the
    background or the track is not of these frames, DeviceError if the device cannot be used.
    """
    check_sequence(sequence, frames)
    check_kind("config", config, ReconstructionConfig)
    check_number("debris", debris, 0, 1)
    if voxel_size is not None:
        check_number("voxel_size, m,", voxel_size, *VOXEL_EDGES)
    stated = None if volume is None else Volume(*SequenceSettings(volume=volume).volume)
    request = ReconstructRequest(
        folder=sequence.folder,
        frames=frames or slice(None),
        voxel_size=voxel_size,
        all_cameras=all_cameras,
        reconstruction=config or ReconstructionConfig(),
    )
    prepared = prepare_reconstruction(
        request,
        sequence,
        resolve_device(device),
        log.warning,
        None if track is None else TrackedBody.open(track),
        stated,
    )

    def clouds() -> Iterator[VoxelCloud]:
        for frame in prepared.session.sequence.frames(frames):
            voxels = prepared.reconstructor(frame)
            cloud = voxels.cloud(colour=colour and frame.images is not None)
            yield remove_debris(cloud, debris)

    return clouds()


def check_sequence(sequence: Sequence, frames: slice | None) -> None:
    """Raise InputError if `sequence` is no open sequence or `frames` no slice."""
    check_kind("sequence", sequence, Sequence, ": psfs.open_sequence(folder)", needed=True)
    check_kind("frames", frames, slice, ", such as slice(0, 100)")
    if frames is not None and frames.step is not None:
        check_number("the step of frames", frames.step, 1)


def resolve_device(device: Device | NumpyDevice | str | None) -> Device | NumpyDevice:
    """Return `device`, or the device of that name, or the fastest one for None. Raises
    DeviceError."""
    check_kind("device", device, (Device, NumpyDevice, str))
    if device is None or isinstance(device, str):
        return select_device(device or "auto")
    return device
