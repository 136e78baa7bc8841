"""Voxels and foreground are divided among people: kernels against the twin, and by hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from helpers import scenes

from cl import Array, Device, InputError
from psfs.background.config import UNKNOWN
from psfs.cameras.camera import CameraRig
from psfs.reference.division import divide_evidence, divide_voxels
from psfs.voxels.division import Division
from psfs.voxels.grid import VoxelGrid

GRID = scenes.small_grid()


@dataclass
class Carved:
    """Voxels and evidence on the device, as a reconstructor has them."""

    surface: Array
    count: Array
    evidence: Array | None
    grid: VoxelGrid = GRID
    stays: bool = False

    def pictures(self) -> None:
        return None


def carve(device: Device, surface: np.ndarray, evidence: np.ndarray) -> Carved:
    """Voxels with room for more than there are, and evidence."""
    room = np.concatenate([surface, np.full(50, -1)]).astype(np.int32)
    count = np.array([len(surface)], np.int32)
    return Carved(*(device.to_device(of) for of in (room, count, evidence)))


def crowd(people: int, seed: int = 0) -> np.ndarray:
    """Spheres (P, 9, 4) of people somewhere in the grid; one is behind all cameras."""
    random = np.random.default_rng(seed)
    feet = random.uniform([-0.6, -0.5, 0], [0.7, 0.6, 0.1], (people, 1, 3))
    spheres = feet + [0, 0, 1.7] * np.linspace(0, 1, 9)[:, None] + random.normal(0, 0.05, (9, 3))
    spheres[0, 0] = 50.0, 50.0, 80.0
    return np.concatenate([spheres, random.uniform(0.03, 0.2, (people, 9, 1))], -1)


@pytest.mark.parity(
    "reconstruction/people.assign_and_project",
    "reconstruction/people.list_voxels",
    "reconstruction/people.divide_evidence",
)
@pytest.mark.parametrize("n_voxels", [0, 1, 3001])
def test_parts_equal_the_twins(device: Device, n_voxels: int) -> None:
    random, rig = np.random.default_rng(n_voxels), scenes.ring(3, size=(81, 63))
    surface = np.sort(random.choice(GRID.size, n_voxels, replace=False))
    evidence = random.integers(-128, 128, (3, rig.height, rig.width)).astype(np.int8)
    spheres = crowd(3).astype(np.float32)
    voxels = carve(device, surface, evidence)
    divide = Division(device, rig, voxels, 3, 9)
    divide.spheres.set(spheres)
    persons = divide()
    for person, expected in zip(persons, divide_voxels(GRID, surface, spheres), strict=True):
        found = person.surface.get(int(person.count.get()[0]))
        np.testing.assert_array_equal(found, np.sort(found))
        assert len(np.setxor1d(found, expected)) <= 2  # at equal distances
    maps = np.stack([person.evidence.get() for person in persons if person.evidence is not None])
    expected = divide_evidence(rig, evidence, spheres)
    assert (maps != expected).mean() < 2e-4
    if n_voxels:
        assert {0, UNKNOWN} <= set(np.unique(expected[:, evidence > 0]))


def test_the_nearer_one_hides_the_other_and_others_are_no_foreground() -> None:
    target, size = np.array([0.0, 0.0, 0.8]), (120, 120)
    camera = scenes.looking_at("before", np.array([4.0, 0.0, 0.8]), target, size, 140)
    rig = scenes.without_distortion(CameraRig((camera,)))
    low = np.array([[0.0, 0.0, 0.4, 0.2], [0.0, 0.0, 1.0, 0.2]])
    nearer, aside = low + np.array([1.0, 0, 0, 0]), low + np.array([0, 0.9, 0, 0])
    evidence = np.full((1, 120, 120), 9, np.int8)
    evidence[:, :4] = -9
    own = divide_evidence(rig, evidence, np.stack([low, nearer, aside]))[:, 0]
    (column, row), _ = camera.project(np.array([[0.0, 0.0, 1.0]]))[0][0], None
    assert own[:, int(row), int(column)].tolist() == [UNKNOWN, 9, 0]
    (column, row), _ = camera.project(np.array([[0.0, 0.9, 1.0]]))[0][0], None
    assert own[:, int(row), int(column)].tolist() == [0, 0, 9]
    assert (own[:, :4] == -9).all()
    assert own[:, 8, 4].tolist() == [0, 0, 0]  # too far from everybody


def test_voxels_without_evidence_are_refused(device: Device) -> None:
    voxels = carve(device, np.arange(3), np.zeros((3, 63, 81), np.int8))
    voxels.evidence = None
    with pytest.raises(InputError, match="no evidence"):
        Division(device, scenes.ring(3, size=(81, 63)), voxels, 2, 9)
