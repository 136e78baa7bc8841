"""Give the keypoints of several people to the people who were followed in the voxels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from apf.keypoints.config import AssociationConfig
from apf.keypoints.keypoints import Keypoints
from psfs.cameras.camera import CameraRig
from psfs.common.matching import match_pairs
from psfs.people.people import People, Person
from psfs.voxels.grid import VoxelGrid


def match_to_people(
    keypoints: Sequence[Keypoints],
    people: People,
    rig: CameraRig,
    config: AssociationConfig | None = None,
) -> list[Keypoints]:
    """Return the keypoints of each of `people`, NaN in frames that have none near the voxels.

    keypoints: of each person that was associated in the pictures, see `Keypoints.open_people`. In
    every frame they are given to the people whose voxels are nearest in the pictures (Hungarian
    method), up to `config.from_voxels`: an identity that was exchanged in the pictures is not
    exchanged here.
    """
    config = config or AssociationConfig()
    points = np.stack([one.points for one in keypoints])
    own = np.full((len(people), *points.shape[1:]), np.nan, np.float32)
    middles = np.stack([_middles(person, people.grid, points.shape[2]) for person in people])
    apart = np.stack([_distances(one, middles, rig) for one in points])
    for frame in np.flatnonzero(np.isfinite(apart).any((0, 1))):
        for k, person in match_pairs(apart[..., frame], config.from_voxels):
            own[person, :, frame] = points[k, :, frame]
    return [replace(keypoints[0], points=of) for of in own]


def _middles(person: Person, grid: VoxelGrid, n_frames: int) -> np.ndarray:
    """Return the middles (F, 3) m of a person's voxels, NaN where there are none."""
    middles = np.full((n_frames, 3), np.nan)
    for frame, voxels in person.voxels.items():
        middles[frame] = grid.centres(voxels).mean(0)
    return middles


def _distances(points: np.ndarray, middles: np.ndarray, rig: CameraRig) -> np.ndarray:
    """Return the distances (P, F) m of keypoints (V, F, K, 3) from people's middles (P, F, 3), mean
    of the cameras; NaN where a frame lacks one of them."""
    with np.errstate(all="ignore"):
        seen = np.isfinite(points).all(-1)
        counts = seen.sum(-1)[..., None]
        means = np.where(seen[..., None], points[..., :2], 0).sum(-2) / counts
    apart = np.full((len(rig), *middles.shape[:2]), np.nan)
    there = np.isfinite(middles).all(-1)
    for view, camera in enumerate(rig):
        pixels, depth = camera.project(middles[there])
        shown = np.full((*there.shape, 2), np.nan)
        shown[there] = np.where(depth[:, None] > 0, pixels, np.nan)
        away = np.full(there.shape, np.nan)
        away[there] = depth
        off = np.linalg.norm(shown - means[view], axis=-1)
        apart[view] = off * away / camera.K[0, 0]
    known = np.isfinite(apart)
    with np.errstate(all="ignore"):
        return np.asarray(np.where(known, apart, 0).sum(0) / known.sum(0))
