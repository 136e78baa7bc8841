"""The reconstruction volume, when nobody states one: from the rig and the first silhouettes."""

from __future__ import annotations

import numpy as np

from cl import Device, InputError, NumpyDevice
from psfs.backend import evidence_for
from psfs.common.ranges import LARGEST
from psfs.reconstructor import ReconstructionConfig
from psfs.sequence import Sequence
from psfs.voxels.bounding_volume import (
    default_voxel_size,
    largest_parts_box,
    reachable_box,
    without_speckle,
)
from psfs.voxels.config import VolumeConfig
from psfs.voxels.grid import VoxelGrid


def automatic_grid(
    sequence: Sequence,
    selection: slice | None = None,
    voxel_size: float | None = None,
    config: ReconstructionConfig | None = None,
    device: Device | NumpyDevice | None = None,
) -> VoxelGrid:
    """Return a grid around everything that moves in the frames of `selection`.

    Without a volume stated by the sequence, the scene within reach of the cameras is
    reconstructed coarsely in some frames spread over the selection; the largest connected part of
    each, all together, with a margin, is the volume, see `VolumeConfig`. voxel_size: m; by default
    2 cm for people and 1/150 of the longest side for smaller scenes. An OpenCL `device` makes the
    silhouettes much faster. Raises InputError if no frame shows anything before the background.
    """
    config = config or ReconstructionConfig()
    low, high = sequence.volume or foreground_box(sequence, selection, config, device)
    if voxel_size is None:
        volume = volume_config(sequence, config)
        voxel_size = default_voxel_size(sequence.rig, low, high, volume)
    return VoxelGrid.covering(low, high, voxel_size)


def volume_config(sequence: Sequence, config: ReconstructionConfig | None = None) -> VolumeConfig:
    """Return how the volume of a sequence is found: objects are taken for people at no distance, so
    that there is no floor and voxels are as small as the object asks for."""
    volume = (config or ReconstructionConfig()).volume
    if sequence.subject == "object":
        return volume.replace(people_distance=LARGEST)
    return volume


def foreground_box(
    sequence: Sequence,
    selection: slice | None = None,
    config: ReconstructionConfig | None = None,
    device: Device | NumpyDevice | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest corner, m, of the volume that `automatic_grid` takes.

    It ends at the floor only where what is seen does, too: see `VolumeConfig.floor_depth`.
    """
    config = config or ReconstructionConfig()
    indices = range(len(sequence))[selection or slice(None)]
    picked = np.unique(np.linspace(0, len(indices) - 1, config.volume.samples).round().astype(int))
    if not len(indices):
        raise InputError(f"{sequence.folder}: the selected frames are none of {len(sequence)}")
    rig, volume = sequence.rig, volume_config(sequence, config)
    evidence_of = evidence_for(device or NumpyDevice(), rig, sequence.background, config.silhouette)
    with sequence.reader(learning=False) as read:
        evidence = [without_speckle(evidence_of(read(indices[int(i)]))) for i in picked]
    min_cameras = config.occupancy.seeing_cameras(len(rig))

    def closer(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        grid = VoxelGrid.covering(low, high, float(np.max(high - low)) / volume.coarse)
        found = largest_parts_box(rig, evidence, grid, min_cameras)
        if found is None:
            raise InputError(
                f"{sequence.folder}: nothing stands out from the background in "
                f"{len(picked)} of the selected frames; expected {expected_person(sequence)}"
            )
        margin = np.maximum(
            volume.margin * (found[1] - found[0]), volume.margin_voxels * grid.voxel_size
        )
        return np.maximum(found[0] - margin, low), np.minimum(found[1] + margin, high)

    everywhere, above = reachable_box(rig, volume, floor=False), reachable_box(rig, volume)
    lowest = volume.floor - volume.floor_depth if above[0][2] > everywhere[0][2] else np.inf
    box = closer(*everywhere)
    if box[0][2] <= lowest:  # else a closer look, which only makes it smaller, says the same
        box = closer(*box)  # finer: it sees what coarse voxels were too large for
    if box[0][2] > lowest:
        return closer(*closer(*above))
    return box


def expected_person(sequence: Sequence) -> str:
    """Return what to ask for in an error, where nothing stands out from the background."""
    if sequence.empty_scene:
        return "a person in view of the cameras"
    return (
        "a person who moves, since the background is learnt from the frames themselves, or "
        "pictures of the empty scene in background/"
    )
