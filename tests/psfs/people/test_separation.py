"""Several people in one volume, and each of them apart from the others."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import footage, scenes

import psfs
from cl import Device, InputError
from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import voxel_footprints
from psfs.people.people import Person, follow_people
from psfs.people.separation import cover_with_spheres, separate
from psfs.sequence import Sequence
from psfs.session import Session, SessionSettings
from psfs.volume import automatic_grid, find_volume
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.host_voxels import voxel_silhouette

STEP = 0.05


def somebody(x: float) -> np.ndarray:
    """Points of a block of 0.3 x 0.3 x 1.5 m that stands at x, y = 0."""
    ends = ((x - 0.15, x + 0.15), (-0.15, 0.15), (0.0, 1.5))
    axes = [np.arange(low, high, STEP) + STEP / 2 for low, high in ends]
    return np.stack(np.meshgrid(*axes), -1).reshape(-1, 3)


def film(folder: Path, points: np.ndarray) -> Path:
    """Write three frames of four cameras that show the same points, as masks."""
    rig = scenes.without_distortion(CameraRig(scenes.ring(4).cameras))
    views = [
        3 * [255 * voxel_silhouette(camera, points, extent, camera.size[::-1]).astype(np.uint8)]
        for camera, extent in zip(rig, voxel_footprints(rig, STEP), strict=True)
    ]
    return footage.write_take(folder, rig, views)


def test_both_people_are_reconstructed(tmp_path: Path, device: Device) -> None:
    both = film(tmp_path, np.concatenate([somebody(-0.6), somebody(0.5)]))
    clouds = list(psfs.reconstruct(psfs.open_sequence(both), device=device, voxel_size=0.05))
    for cloud in clouds:
        assert cloud.centres[:, 0].min() < -0.65 and cloud.centres[:, 0].max() > 0.55
        assert not (np.abs(cloud.centres[:, 0] + 0.05) < 0.1).any()  # the gap between them


def test_each_person_is_reconstructed_without_the_other(tmp_path: Path, device: Device) -> None:
    folder = film(tmp_path, np.concatenate([somebody(-0.3), somebody(0.3)]))
    session = Session(Sequence.open(folder), device, SessionSettings(voxel_size=0.05))
    people = follow_people(session, 2)
    sessions = separate(session, people)
    means = []
    for own, person in zip(sessions, people, strict=True):
        assert list(own.frames) == list(person.frames) == [0, 1, 2]
        assert (find_volume(own).low < -0.1).all()
        grid = automatic_grid(own)
        reconstruct = own.reconstructor(grid)
        cloud = reconstruct(own.sequence.read(1)).cloud()
        means.append(cloud.centres[:, 0].mean())
        assert np.ptp(cloud.centres[:, 0]) < 0.5 and np.ptp(cloud.centres[:, 2]) > 1.3
        (maps,) = own.evidence([1])
        np.testing.assert_array_equal(maps, reconstruct.evidence())
        with pytest.raises(InputError, match="their own grid"):
            own.reconstructor(replace(grid, voxel_size=0.1))
    assert sorted(np.sign(means)) == [-1, 1]
    # Once the bodies are known they say who is where: here that they have changed places.
    for number, x in enumerate(means):
        body = np.array([[-x, 0, z, 0.15] for z in np.arange(0.1, 1.5, 0.1)], np.float32)
        sessions[0].joint.place(number, {2: body})
    for own, x in zip(sessions, means, strict=True):
        reconstruct = own.reconstructor(automatic_grid(own))
        clouds = [reconstruct(own.sequence.read(frame)).cloud() for frame in (1, 2)]
        assert np.sign([cloud.centres[:, 0].mean() for cloud in clouds]).tolist() == [
            np.sign(x), -np.sign(x),
        ]  # fmt: skip


def test_spheres_have_the_middle_and_the_volume_of_the_coarse_voxels() -> None:
    grid = VoxelGrid.covering(np.zeros(3), np.ones(3), 0.1)
    voxels = np.ravel_multi_index(np.indices((4, 2, 3)).reshape(3, -1), grid.shape)
    spheres = cover_with_spheres(grid, Person(np.array([7]), {7: voxels}))[7]
    assert len(spheres) == 4
    assert np.sum(spheres[:, 3] ** 3) * 4 / 3 * np.pi == pytest.approx(len(voxels) * 0.1**3)
    np.testing.assert_allclose(spheres[:, :3].min(0), [0.1, 0.1, 0.1], atol=1e-6)
