"""What the pictures show joins the voxels' silhouettes: kernels against the twin, and by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers import scenes
from scipy import ndimage

from cl import Device
from psfs.cameras.camera import CameraRig
from psfs.reconstructor import Reconstructor
from psfs.reference.reprojection import join_foreground
from psfs.voxels.reprojection import Reprojection


def blobs(rig: CameraRig, seed: int = 0) -> np.ndarray:
    """(V, H, W) int8 evidence: blobs of all sizes, noise, and counts at the ends of their range."""
    random = np.random.default_rng(seed)
    shape = (len(rig), rig.height, rig.width)
    smooth = ndimage.gaussian_filter(random.normal(size=shape), (0, 4, 4))
    evidence = np.where(smooth > 0.08, 127, -127) * random.choice([0, 1], shape, p=[0.1, 0.9])
    evidence[random.random(shape) < 0.01] = 1
    return evidence.astype(np.int8)


@pytest.mark.parity(
    "reconstruction/foreground_join.person_box",
    "reconstruction/foreground_join.foreground_bits",
    "reconstruction/foreground_join.join_foreground",
)
@pytest.mark.parametrize("size", [(160, 120), (163, 117)])
def test_silhouettes_equal_the_twins(device: Device, size: tuple[int, int]) -> None:
    rig, grid = scenes.ring(3, size=size), scenes.small_grid()
    voxels = Reconstructor(device, rig, grid, None)(scenes.frame(masks=scenes.masks_of(rig)))
    alone = Reprojection(device, rig, grid)(voxels).get()[..., 0] > 0
    evidence = blobs(rig)
    voxels.evidence = device.to_device(evidence)
    found = Reprojection(device, rig, grid, join=True)(voxels).get()[..., 0] > 0
    expected = [join_foreground(s, e) for s, e in zip(alone, evidence, strict=True)]
    np.testing.assert_array_equal(found, expected)
    assert (found != alone).any() and alone.any()


def test_a_limb_that_was_carved_away_is_there_again_and_speckle_is_not() -> None:
    silhouette, evidence = np.zeros((120, 160), bool), np.full((120, 160), -50, np.int8)
    silhouette[30:100, 60:80] = True
    evidence[30:100, 60:80] = 50
    evidence[44:49, 80:100] = 50  # an arm of 5 x 20 px
    evidence[60, 90] = evidence[70:73, 95:98] = 50  # speckle
    evidence[40:60, 140:160] = 50  # somebody else, further away than a third of the height
    expected = silhouette.copy()
    expected[44:49, 80:100] = True
    np.testing.assert_array_equal(join_foreground(silhouette, evidence), expected)


def test_voxels_without_evidence_and_a_join_that_is_off_change_nothing(device: Device) -> None:
    rig, grid = scenes.ring(2), scenes.small_grid()
    voxels = Reconstructor(device, rig, grid, None)(scenes.frame(masks=scenes.masks_of(rig)))
    alone = Reprojection(device, rig, grid)(voxels).get()
    bare = SimpleNamespace(grid=grid, surface=voxels.surface, count=voxels.count, evidence=None)
    voxels.evidence = device.to_device(blobs(rig))
    for shown, join in ((bare, True), (voxels, False)):
        maps = Reprojection(device, rig, grid, join=join)(shown).get()  # type: ignore[arg-type]
        np.testing.assert_array_equal(maps, alone)
