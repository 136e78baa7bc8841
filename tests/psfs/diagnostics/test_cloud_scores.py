"""The scores of clouds whose faults are known."""

import numpy as np
import pytest
from helpers import scenes
from scipy import ndimage

from psfs.diagnostics.mask_scores import mean_scores, score_cloud
from psfs.reference.surface import surface_voxels
from psfs.voxels.grid import VoxelCloud

RIG, GRID = scenes.ring(), scenes.small_grid()
MASKS = [mask > 0 for mask in scenes.masks_of(RIG)]


def hull() -> np.ndarray:
    inside = np.ones(GRID.size, bool)
    for camera, mask in zip(RIG, MASKS, strict=True):
        seen, row, column, _ = camera.look_up(GRID.centres())
        inside[seen] &= mask[row, column]
    return inside


def cloud_of(voxels: np.ndarray, closed: bool = True) -> VoxelCloud:
    indices = surface_voxels(voxels.reshape(GRID.shape), closed)
    return VoxelCloud(GRID, indices, np.ones(len(indices), np.float32))


def test_the_hull_is_the_ceiling() -> None:
    score = score_cloud(RIG, cloud_of(hull()), MASKS)
    assert 0.75 < score.ceiling < 1 and score.ghosts == 0
    assert score.iou == pytest.approx(score.ceiling, abs=0.01)


def test_lost_and_added_voxels_cost() -> None:
    centres, inside = GRID.centres(), hull()
    lost = score_cloud(RIG, cloud_of(inside & (centres[:, 2] < 1.2)), MASKS)
    beside = (np.abs(centres - [-0.5, 0.4, 0.5]) < 0.15).all(1)
    added = score_cloud(RIG, cloud_of(inside | beside), MASKS)
    whole = score_cloud(RIG, cloud_of(inside), MASKS)
    assert lost.iou < whole.iou - 0.1 and lost.ghosts == 0
    assert added.iou < whole.iou - 0.05 and added.ghosts > 0.05
    assert lost.ceiling == added.ceiling == whole.ceiling


@pytest.mark.parametrize("closed", [True, False])
def test_the_volume_is_that_within_the_surface(closed: bool) -> None:
    inside = hull().reshape(GRID.shape)
    thin = ndimage.binary_erosion(inside)
    whole, less = (score_cloud(RIG, cloud_of(voxels, closed), MASKS) for voxels in (inside, thin))
    seen = np.all([camera.look_up(GRID.centres())[0] for camera in RIG], axis=0)
    kept = seen & inside.ravel()
    assert whole.volume == 1
    assert less.volume == pytest.approx((kept & thin.ravel()).sum() / kept.sum())
    nothing = score_cloud(RIG, cloud_of(np.zeros_like(inside), closed), MASKS)
    assert nothing.volume == 0


def test_cameras_without_a_mask_and_nothing_at_all() -> None:
    cloud = cloud_of(hull())
    score = score_cloud(RIG, cloud, [None, *MASKS[1:]])
    assert score.iou > 0.75
    nothing = score_cloud(RIG, cloud, [None] * len(RIG))
    assert (
        np.isnan(nothing.volume) and np.isnan(nothing.iou) and mean_scores([nothing])["iou"] is None
    )
    assert mean_scores([score, nothing])["iou"] == pytest.approx(score.iou)
