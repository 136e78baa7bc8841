"""Surface voxels of a person who walks along x, without cameras or pictures."""

import numpy as np

from apf.body.toml import load_body
from apf.initialisation.kept_voxels import StoredVoxels
from cl import Device
from helpers import bodies
from psfs.voxels.grid import VoxelCloud, VoxelGrid

SONG = load_body("song31")
GRID = VoxelGrid.covering(np.array([-0.8, -0.7, -0.1]), np.array([1.9, 0.7, 1.9]), 0.04)


def walker(frame: int, jump: float = 0.0) -> np.ndarray:
    """Return a pose (31,) of a person walking along x with one arm out, so that the front is
    recognisable."""
    place = 0.012 * frame + jump
    return bodies.bent(SONG, pelvis__tx=place, l_upper_arm__rx=0.9, r_thigh__ry=0.3, l_calf__ry=0.5)


def surface_voxels(device: Device, pose: np.ndarray | None) -> StoredVoxels:
    """Return the surface voxels of a pose; none for None."""
    indices = np.zeros(0, np.int32)
    if pose is not None:
        indices = bodies.voxels_of(SONG, pose, GRID)[1].astype(np.int32)
    return StoredVoxels(device, VoxelCloud(GRID, indices, np.ones(len(indices), np.float32)))
