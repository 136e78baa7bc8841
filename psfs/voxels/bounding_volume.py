"""The reconstruction volume, when nobody states one: from the rig and the first silhouettes."""

from __future__ import annotations

import cv2
import numpy as np
from scipy import ndimage

from cl import Device, InputError, NumpyDevice
from psfs.cameras.camera import CameraRig
from psfs.config import ReconstructionConfig, SilhouetteConfig
from psfs.reconstructor import frame_input
from psfs.reference.reconstructor import frame_evidence
from psfs.sequence import Sequence
from psfs.silhouettes.silhouette import Silhouette
from psfs.voxels.grid import VoxelGrid

#: Voxels along the longest side: in the coarse search; by default for things; at most for people.
_COARSE, _FINE, _FINEST = 64, 150, 400
#: Share added to each side of the box found, and at least this many coarse voxels.
_MARGIN, _MARGIN_VOXELS = 0.06, 1.5
#: Rigs whose cameras stand at least this far away, m, film people: 2 cm voxels serve them.
_PEOPLE_DISTANCE, _PEOPLE_VOXEL = 1.5, 0.02


def automatic_grid(
    sequence: Sequence,
    selection: slice | None = None,
    voxel_size: float | None = None,
    config: ReconstructionConfig | None = None,
    device: Device | NumpyDevice | None = None,
    samples: int = 8,
) -> VoxelGrid:
    """A grid around everything that moves in the frames of `selection`.

    Without a volume stated by the sequence, the scene within reach of the cameras is
    reconstructed coarsely in `samples` frames spread over the selection; the largest connected
    part of each, all together, with a margin, is the volume. voxel_size: m; by default 2 cm for
    people and 1/150 of the longest side for smaller scenes. An OpenCL `device` makes the
    silhouettes much faster. Raises InputError if no frame shows anything before the background.
    """
    low, high = sequence.volume or foreground_box(sequence, selection, config, device, samples)
    if voxel_size is None:
        voxel_size = default_voxel_size(sequence.rig, low, high)
    return VoxelGrid.covering(low, high, voxel_size)


def default_voxel_size(rig: CameraRig, low: np.ndarray, high: np.ndarray) -> float:
    """2 cm when the cameras stand as far as people need, else 1/150 of the longest side, m."""
    middle = (np.asarray(low) + np.asarray(high)) / 2
    distance = np.median(np.linalg.norm(rig.centres - middle, axis=1))
    longest = float(np.max(np.asarray(high) - low))
    if distance >= _PEOPLE_DISTANCE:
        return max(_PEOPLE_VOXEL, longest / _FINEST)
    return longest / _FINE


def finest_pixel(rig: CameraRig, grid: VoxelGrid) -> float:
    """What a pixel covers in the middle of the grid at least, m."""
    distances = np.linalg.norm(rig.centres - (grid.low + grid.high) / 2, axis=1)
    focal = [camera.K[[0, 1], [0, 1]].max() for camera in rig]
    return float(np.min(distances / focal))


def foreground_box(
    sequence: Sequence,
    selection: slice | None = None,
    config: ReconstructionConfig | None = None,
    device: Device | NumpyDevice | None = None,
    samples: int = 8,
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner, m, of the volume that `automatic_grid` takes."""
    indices = range(len(sequence))[selection or slice(None)]
    picked = np.unique(np.linspace(0, len(indices) - 1, samples).round().astype(int))
    if not len(indices):
        raise InputError(f"{sequence.folder}: the selected frames are none of {len(sequence)}")
    rig, config = sequence.rig, config or ReconstructionConfig()
    evidence = _evidence(sequence, [indices[int(i)] for i in picked], config.silhouette, device)
    min_cameras = config.occupancy.seeing_cameras(len(rig))
    low, high = reachable_box(rig)
    for _ in range(2):  # the second, finer pass sees what the coarse voxels were too large for
        grid = VoxelGrid.covering(low, high, float(np.max(high - low)) / _COARSE)
        found = _largest_parts(rig, evidence, grid, min_cameras)
        if found is None:
            raise InputError(
                f"{sequence.folder}: nothing stands out from the background in "
                f"{len(picked)} of the selected frames; expected {expected_person(sequence)}"
            )
        margin = np.maximum(_MARGIN * (found[1] - found[0]), _MARGIN_VOXELS * grid.voxel_size)
        low, high = np.maximum(found[0] - margin, low), np.minimum(found[1] + margin, high)
    return low, high


def expected_person(sequence: Sequence) -> str:
    """What to ask for in an error, where nothing stands out from the background."""
    if sequence.empty_scene:
        return "a person in view of the cameras"
    return (
        "a person who moves, since the background is learnt from the frames themselves, or "
        "pictures of the empty scene in background/"
    )


def reachable_box(rig: CameraRig) -> tuple[np.ndarray, np.ndarray]:
    """A box around the point that the cameras look at, as large as they leave room for, m.

    The point is the nearest one to all optical axes; the box reaches as far as the median
    camera stands from it. Rigs of people's size stand on the floor: nothing below z = -0.1 m.
    """
    axes = np.stack([camera.R[2] for camera in rig])
    projectors = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    # Parallel axes meet nowhere: a weak pull keeps the point in front of the cameras.
    distance = float(np.linalg.norm(rig.centres - rig.centres.mean(0), axis=1).mean()) or 3.0
    ahead = (rig.centres + distance * axes).mean(0)
    pull = 1e-3 * np.eye(3)
    target = np.linalg.solve(
        projectors.sum(0) + pull, (projectors @ rig.centres[:, :, None]).sum(0)[:, 0] + pull @ ahead
    )
    reach = float(np.median(np.linalg.norm(rig.centres - target, axis=1)))
    low, high = target - reach, target + reach
    if reach >= _PEOPLE_DISTANCE and low[2] < -0.1 < high[2] - 1.0:
        low[2] = -0.1
    return low, high


def _evidence(
    sequence: Sequence,
    indices: list[int],
    config: SilhouetteConfig,
    device: Device | NumpyDevice | None,
) -> list[np.ndarray]:
    """Evidence counts (V, H, W) int8 of some frames."""
    frames = (sequence.read(index) for index in indices)
    rig, background = sequence.rig, sequence.background
    if isinstance(device, Device):
        silhouette = Silhouette(device, rig, background, config)
        return [silhouette(frame_input(frame, background)).get() for frame in frames]
    return [frame_evidence(frame, rig, background, config) for frame in frames]


def _largest_parts(
    rig: CameraRig, evidence: list[np.ndarray], grid: VoxelGrid, min_cameras: int
) -> tuple[np.ndarray, np.ndarray] | None:
    """Box around the largest connected part of every frame, m, or None if all are empty."""
    centres = grid.centres()
    votes = np.zeros((len(evidence), grid.size), np.int32)
    seeing = np.zeros(grid.size, np.int32)
    for view, camera in enumerate(rig):
        inside, row, column, depth = camera.look_up(centres)
        if not len(depth):
            continue
        seeing += inside
        covered = grid.voxel_size * camera.K[0, 0] / float(np.median(depth))
        for frame, maps in enumerate(evidence):
            votes[frame, inside] += _widened(maps[view], covered)[row, column]
    occupied = (votes > 0) & (seeing >= min_cameras)
    parts = [_largest_part(frame.reshape(grid.shape)) for frame in occupied]
    corners = np.array([part for part in parts if part is not None])
    if not len(corners):
        return None
    low, high = corners[:, 0].min(0), corners[:, 1].max(0)
    return grid.origin + low * grid.voxel_size, grid.origin + high * grid.voxel_size


def _widened(evidence: np.ndarray, pixels: float) -> np.ndarray:
    """Evidence (H, W) without speckle, its foreground widened to voxels `pixels` across."""
    offset = np.uint8(128)  # between int8 and the 0..255 that OpenCV wants
    smooth = cv2.medianBlur(evidence.view(np.uint8) ^ offset, 5)
    size = max(1, round(pixels))
    wide = np.asarray(cv2.dilate(smooth, np.ones((size, size), np.uint8)), np.uint8)
    return (wide ^ offset).view(np.int8)


def _largest_part(occupied: np.ndarray) -> np.ndarray | None:
    """First and last + 1 index (2, 3) of the largest connected part, or None."""
    labels, count = ndimage.label(occupied, np.ones((3, 3, 3)))
    if not count:
        return None
    largest = int(np.bincount(labels.ravel())[1:].argmax())
    part = ndimage.find_objects(labels)[largest]
    return np.array([[s.start for s in part], [s.stop for s in part]])
