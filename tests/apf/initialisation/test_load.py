"""What a person carries is a part of the body."""

import numpy as np
import pytest
from helpers import bodies

from apf.body.kinematics import bone_matrices, posed_cones
from apf.body.toml import load_body
from apf.initialisation.load import add_load, find_load
from psfs.common.cones import cone_distances
from psfs.voxels.grid import VoxelCloud, VoxelGrid

BODY = load_body("song32")
SIZE, MIDDLE = 0.36, np.array([0.42, 0.03, 0.15])


def walking(n: int = 6) -> np.ndarray:
    """(n, D) poses of somebody who walks, turns, and holds the forearms forward."""
    poses, places = bodies.random_poses(BODY, n, 5), BODY.dof_names.index
    for name, values in (
        ("pelvis.tx", np.linspace(-0.5, 0.5, n)),
        ("pelvis.ty", 0.1),
        ("pelvis.rz", np.linspace(0, 1.5, n)),
        *((f"{side}_forearm.ry", 1.4) for side in "lr"),
    ):
        poses[:, places(name)] = values
    return poses


def clouds(poses: np.ndarray, held: range, size: float = SIZE) -> list[VoxelCloud]:
    """Voxels of the bodies, and of a cube of this `size`, m, in the `held` frames."""
    grid = VoxelGrid.covering(np.array([-1.2, -0.8, 0]), np.array([1.2, 1.2, 1.9]), 0.05)
    centres, frames = grid.centres(), []
    rotations, origins = bone_matrices(BODY, poses)
    for frame, cones in enumerate(posed_cones(BODY, poses)):
        inside = cone_distances(centres, cones).min(1) < 0
        if frame in held:
            local = (centres - origins[frame, 0]) @ rotations[frame, 0]
            inside |= (np.abs(local - MIDDLE) < size / 2).all(1)
        indices = np.flatnonzero(inside).astype(np.int32)
        frames.append(VoxelCloud(grid, indices, np.ones(len(indices), np.float32)))
    return frames


def test_a_box_that_moves_with_the_trunk_is_found() -> None:
    """Though the arms are tracked into it; it is added in the size of the template."""
    poses = walking()
    voxels = clouds(poses, range(6))
    for side in "lr":
        poses[:, BODY.dof_names.index(f"{side}_upper_arm.ry")] += 0.7
    load = find_load(BODY, poses, voxels)
    ends = np.array([[cone.start, cone.end] for cone in load])
    radii = np.array([cone.radii[0] for cone in load])
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    volume = np.sum(np.pi * radii**2 * (lengths + 4 / 3 * radii))
    assert len(load) == 4
    assert 0.4 < volume / SIZE**3 < 1  # without edges and corners
    np.testing.assert_allclose(ends.mean((0, 1)), MIDDLE, atol=0.05)
    loaded = add_load(BODY, load, 0.88)
    assert loaded.cone_names[-4:] == ["load_1", "load_2", "load_3", "load_4"]
    np.testing.assert_allclose(loaded.cones[-1].start / load[-1].start, 2.0, rtol=0.03)
    apart = {
        (BODY.cone_names[a], loaded.cone_names[b])
        for a, b in loaded.apart[len(BODY.apart) :]
    }  # fmt: skip
    arms = {f"{side}_{part}" for side in "lr" for part in ("upper_arm", "forearm")}
    assert {arm for arm, _ in apart} == arms and len(apart) == 16


@pytest.mark.parametrize(("held", "size"), [(range(4), SIZE), (range(6), 0.1)])
def test_people_arms_and_what_passes_are_no_load(held: range, size: float) -> None:
    poses = walking()
    assert find_load(BODY, poses, clouds(poses, held, size)) == []
