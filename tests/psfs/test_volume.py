"""The automatic reconstruction volume."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import scenes
from helpers.shared import shared_data

from cl import Device, InputError, NumpyDevice
from psfs.cameras.camera import CameraRig
from psfs.sequence import Frame, Sequence
from psfs.session import Session, SessionSettings
from psfs.volume import automatic_grid
from psfs.voxels.grid import VoxelGrid


@dataclass
class Footage:
    """As much of a `Sequence` as the volume needs."""

    rig: CameraRig
    masks: list[np.ndarray]
    volume: tuple[np.ndarray, np.ndarray] | None = None
    background: None = None
    background_kind: str = "masks"
    subject: str = "person"
    folder: Path = field(default_factory=lambda: Path("footage"))

    def __len__(self) -> int:
        return len(self.masks)

    @contextmanager
    def reader(self, learning: bool) -> Iterator[Callable[[int], Frame]]:
        assert not learning
        yield lambda index: scenes.frame(index, masks=self.masks[index])

    def select_frames(self, indices: list[int]) -> Iterator[Frame]:
        return (scenes.frame(index, masks=self.masks[index]) for index in indices)


def session(
    footage: Any, device: Device | NumpyDevice | None = None, voxel_size: float | None = None
) -> Session:
    return Session(footage, device or NumpyDevice(), SessionSettings(voxel_size=voxel_size))


def test_the_body_lies_inside(device: Device) -> None:
    rig = scenes.ring(5)
    footage = Footage(rig, [scenes.masks_of(rig)] * 3)
    for grid in (automatic_grid(session(footage)), automatic_grid(session(footage, device))):
        assert grid.voxel_size == 0.02
        assert np.all(grid.low < [-0.2, -0.3, 0.2]) and np.all(grid.high > [0.4, 0.3, 1.6])
        assert np.all(grid.high - grid.low < [1.4, 1.4, 2.4])


def test_one_camera_of_four_may_deny_the_body() -> None:
    rig = scenes.ring(4)
    masks = scenes.masks_of(rig)
    masks[1] = 0
    grid = automatic_grid(session(Footage(rig, [masks] * 3)))
    assert np.all(grid.low < [-0.2, -0.3, 0.2]) and np.all(grid.high > [0.4, 0.3, 1.6])
    assert np.all(grid.high - grid.low < [1.4, 1.4, 2.4])
    three = scenes.ring(3)
    with pytest.raises(InputError, match="nothing stands out"):
        automatic_grid(session(Footage(three, [masks[:3]])))


def test_a_stated_volume_is_taken() -> None:
    volume = np.array([-1.0, -1, 0]), np.array([1.0, 1, 2])
    footage = Footage(scenes.ring(2), [], volume)
    grid = automatic_grid(session(footage, voxel_size=0.1))
    assert grid.shape == (20, 20, 20)
    with pytest.raises(InputError, match="voxel size is 0"):
        automatic_grid(session(footage, voxel_size=0.0))


def test_only_background_is_an_error() -> None:
    rig = scenes.ring(3)
    empty = np.zeros((3, rig.height, rig.width), np.uint8)
    with pytest.raises(InputError, match=r"nothing stands out .*; expected masks"):
        automatic_grid(session(Footage(rig, [empty] * 20)))


def test_real_sets() -> None:
    dino = automatic_grid(session(Sequence.open(shared_data("middlebury_dino"))))
    assert 0.05 < np.max(dino.high - dino.low) < 0.2 and dino.voxel_size < 0.002
    dancer = automatic_grid(session(Sequence.open(shared_data("dancer8"))))
    inside = VoxelGrid.covering(np.array([-0.26, -1.64, 0.0]), np.array([0.94, -1.12, 1.65]), 0.1)
    assert np.all(dancer.low < inside.low + 0.05) and np.all(dancer.high > inside.high - 0.1)
