"""Pixels where furniture hides what is behind it: kernels against the twin, and what they do."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import scenes

from cl import Device, InputError, NumpyDevice
from psfs.backend import make_reconstructor
from psfs.cameras.camera import CameraRig
from psfs.reconstructor import Reconstructor
from psfs.reference.reprojection import NumpyReprojection, hide, mark_hidden
from psfs.reference.surface import occupancy, smooth
from psfs.silhouettes.hidden import HIDDEN, UNKNOWN, hide_launch
from psfs.voxels.bricks import Bricks
from psfs.voxels.reprojection import Reprojection

RIG = scenes.ring(5)
GRID = scenes.small_grid()


def some_hidden(rig: CameraRig, seed: int = 0) -> np.ndarray:
    """(V, H, W) bool: blocks of some cameras."""
    random = np.random.default_rng(seed)
    coarse = random.random((len(rig), rig.height // 9 + 1, rig.width // 9 + 1)) < 0.3
    coarse[1] = False
    return coarse.repeat(9, 1).repeat(9, 2)[:, : rig.height, : rig.width]


@pytest.mark.parity("reconstruction/hidden.hide")
def test_hidden_pixels_deny_nobody(device: Device) -> None:
    evidence, hidden = scenes.patches_of_evidence(RIG, 1, 5), some_hidden(RIG)
    there = device.to_device(evidence)
    hide_launch(device, hidden, there)()
    found = there.get()
    np.testing.assert_array_equal(found, hide(evidence, hidden))
    assert (found[hidden & (evidence <= 0)] == UNKNOWN).all()
    kept = ~hidden | (evidence > 0)
    np.testing.assert_array_equal(found[kept], evidence[kept])


@pytest.mark.parity(
    "reconstruction/occupancy.sparse_occupancy", "reconstruction/tiles.evidence_tiles"
)
def test_hidden_cameras_alone_make_no_voxel(device: Device) -> None:
    evidence = hide(scenes.patches_of_evidence(RIG, 3, 8), some_hidden(RIG))
    config = scenes.ALL_BRICKS.replace(min_cameras=4)
    less = occupancy(RIG, GRID, np.where(evidence == UNKNOWN, HIDDEN, evidence), 0.05, config)
    np.testing.assert_array_equal(occupancy(RIG, GRID, evidence, 0.05, config), less)
    whole = evidence.copy()
    whole[2] = UNKNOWN  # a picture whose tiles are all the same
    for maps in (evidence, whole):
        found = scenes.carve(Bricks(device, RIG, GRID, device.to_device(maps), 0.05, config))
        expected = smooth(occupancy(RIG, GRID, maps, 0.05, config), True)
        assert (np.abs(found - expected) > 1e-5).mean() < 1e-2


def test_furniture_before_the_body_carves_nothing(device: Device) -> None:
    """One camera shows the background where a table stands before the body: without a map of it the
    body has a hole, in all cameras' eyes."""
    frame, _ = scenes.pictures_of(RIG)
    assert frame.masks is not None
    table = np.zeros(frame.masks.shape, bool)
    table[0, 35:50] = True
    spoilt = replace(frame, masks=np.where(table, np.uint8(0), frame.masks))
    counts = {}
    for name, rig, shown in (
        ("whole", RIG, frame),
        ("carved", RIG, spoilt),
        ("known", RIG.with_hidden(table), spoilt),
    ):
        for where in (device, NumpyDevice()):
            voxels = make_reconstructor(where, rig, GRID, None)(shown)
            counts[name, where.name] = len(voxels.cloud())
        assert abs(counts[name, device.name] - counts[name, "numpy"]) <= 3
    whole, carved, known = (counts[name, device.name] for name in ("whole", "carved", "known"))
    assert carved < 0.9 * whole <= known < 1.2 * whole


def test_reprojected_maps_are_marked(device: Device) -> None:
    frame, background = scenes.pictures_of(RIG)
    rig = RIG.with_hidden(some_hidden(RIG))
    voxels = Reconstructor(device, rig, GRID, background)(frame)
    maps = Reprojection(device, rig, GRID)(voxels).get()
    expected = Reprojection(device, RIG, GRID)(voxels).get()
    mark_hidden(expected, voxels.evidence.get())
    np.testing.assert_array_equal(maps, expected)
    twin = make_reconstructor(NumpyDevice(), rig, GRID, background)(frame)
    expected = NumpyReprojection(NumpyDevice(), rig, GRID)(twin)
    hidden = np.isin(maps[..., 0], (1, 254))
    assert hidden.any() and not hidden[1].any()
    assert (maps[..., 0] != expected[..., 0]).mean() < 0.02


def test_maps_of_another_size_are_refused() -> None:
    with pytest.raises(InputError, match=r"camera c0: hidden is \(3, 4\); expected"):
        replace(RIG[0], hidden=np.zeros((3, 4), bool))
