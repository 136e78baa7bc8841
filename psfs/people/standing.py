"""The background of a take in which people keep still, estimated again from where they stand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psfs.background.gaussian import Background
from psfs.background.standing import StandingPeople
from psfs.background.take import estimate_background_from_take
from psfs.people.config import AxisConfig
from psfs.session import Session
from psfs.voxels.grid import VoxelGrid


def estimate_again(session: Session, standing: StandingPeople, near: bool = False) -> Background:
    """Return the background estimated again from the take, in which people who keep still hide it
    where they stand; see `estimate_background_from_take`."""
    rig, images = session.rig, session.sequence.footage.images
    assert images is not None
    return estimate_background_from_take(rig, images, standing=standing, near=near)


def find_places(
    grid: VoxelGrid,
    frames: Sequence[int],
    persons: Sequence[dict[int, np.ndarray]],
    config: AxisConfig | None = None,
) -> StandingPeople:
    """Return where people stand in `frames`: the axis and the top of each one's coarse voxels of
    `grid`, flat indices by frame."""
    config = config or AxisConfig()
    places = np.full((len(frames), len(persons), 3), np.nan)
    for number, voxels in enumerate(persons):
        for row, frame in enumerate(frames):
            if frame in voxels:
                axis, top = _find_axis(grid.centres(voxels[frame]), config)
                places[row, number] = *axis, top + grid.voxel_size / 2
    return StandingPeople(np.array(frames), places)


def _find_axis(points: np.ndarray, config: AxisConfig) -> tuple[np.ndarray, float]:
    """Return the vertical axis (2,) that most of the points (N, 3) are near to, and the highest z
    about it, m."""
    flat, heights = np.unique(points[:, :2], axis=0, return_counts=True)
    apart = np.linalg.norm(flat[:, None] - flat, axis=-1)
    around = np.exp(-0.5 * (apart / config.width) ** 2) @ heights
    near = apart[around.argmax()] < config.reach
    axis = np.average(flat[near], axis=0, weights=heights[near])
    about = np.linalg.norm(points[:, :2] - axis, axis=1) < config.reach
    return axis, float(points[about, 2].max())
