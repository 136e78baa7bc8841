"""The automatic reconstruction volume."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import footage, scenes
from helpers.shared import shared_data

from cl import Device, InputError, NumpyDevice
from psfs.cameras.camera import CameraRig
from psfs.sequence import Sequence
from psfs.session import Session, SessionSettings
from psfs.volume import automatic_grid
from psfs.voxels.grid import VoxelGrid


def session(
    sequence: Sequence, device: Device | NumpyDevice | None = None, voxel_size: float | None = None
) -> Session:
    return Session(sequence, device or NumpyDevice(), SessionSettings(voxel_size=voxel_size))


def opened(folder: Path, rig: CameraRig, masks: np.ndarray, **settings: Any) -> Sequence:
    """A sequence of three frames with the same masks (V, H, W)."""
    return Sequence.open(
        footage.write_take(folder, rig, [3 * [mask] for mask in masks]), **settings
    )


def test_the_body_lies_inside(tmp_path: Path, device: Device) -> None:
    rig = scenes.ring(5)
    sequence = opened(tmp_path, rig, scenes.masks_of(rig))
    for grid in (automatic_grid(session(sequence)), automatic_grid(session(sequence, device))):
        assert grid.voxel_size == 0.02
        assert np.all(grid.low < [-0.2, -0.3, 0.2]) and np.all(grid.high > [0.4, 0.3, 1.6])
        assert np.all(grid.high - grid.low < [1.4, 1.4, 2.4])


def test_one_camera_of_four_may_deny_the_body(tmp_path: Path) -> None:
    rig = scenes.ring(4)
    masks = scenes.masks_of(rig)
    masks[1] = 0
    grid = automatic_grid(session(opened(tmp_path / "four", rig, masks)))
    assert np.all(grid.low < [-0.2, -0.3, 0.2]) and np.all(grid.high > [0.4, 0.3, 1.6])
    assert np.all(grid.high - grid.low < [1.4, 1.4, 2.4])
    three = scenes.ring(3)
    with pytest.raises(InputError, match=r"nothing stands out .*; expected masks"):
        automatic_grid(session(opened(tmp_path / "three", three, masks[:3])))


def test_a_stated_volume_is_taken(tmp_path: Path) -> None:
    rig, volume = scenes.ring(2), ((-1.0, -1, 0), (1.0, 1, 2))
    sequence = opened(tmp_path, rig, scenes.masks_of(rig), volume=volume)
    assert automatic_grid(session(sequence, voxel_size=0.1)).shape == (20, 20, 20)
    with pytest.raises(InputError, match="voxel size is 0"):
        automatic_grid(session(sequence, voxel_size=0.0))


def test_real_sets() -> None:
    dino = automatic_grid(session(Sequence.open(shared_data("middlebury_dino"))))
    assert 0.05 < np.max(dino.high - dino.low) < 0.2 and dino.voxel_size < 0.002
    dancer = automatic_grid(session(Sequence.open(shared_data("dancer8"))))
    inside = VoxelGrid.covering(np.array([-0.26, -1.64, 0.0]), np.array([0.94, -1.12, 1.65]), 0.1)
    assert np.all(dancer.low < inside.low + 0.05) and np.all(dancer.high > inside.high - 0.1)
