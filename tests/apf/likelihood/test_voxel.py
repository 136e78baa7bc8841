"""Errors of particles: the kernels against the twin."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.likelihoods import CONFIG, FRONT, Setup, cloud, only, smooth_maps

from apf.body.kinematics import posed_cones
from apf.body.model import BodyModel
from apf.likelihood.voxel import VoxelLikelihood, choose_cone_sampling
from apf.reference.likelihood.voxel import (
    FrameEvidence,
    sampled_surface,
    total_errors,
)
from apf.scene import Scene
from cl import Array, Device, InputError
from psfs.cameras.camera import CameraRig
from psfs.voxels.grid import VoxelGrid

NO_POINTS = np.empty((0, 3))


def point_sampler(
    device: Device, body: BodyModel, grid: VoxelGrid, indices: np.ndarray, n_points: int
) -> tuple[VoxelLikelihood, np.ndarray]:
    """A likelihood that has sampled the surface voxels `indices`; its points (n_points, 4)."""
    config = CONFIG.with_changes(n_points=n_points).likelihood
    likelihood = VoxelLikelihood(Scene(device, scenes.ring(1), grid, body), config, 2)
    surface: Array = device.empty(grid.size, np.int32)
    padded = np.full(grid.size, grid.size - 1, np.int32)  # what is beyond `count` is stale
    padded[: len(indices)] = indices
    surface.set(padded)
    count = device.to_device(np.array([len(indices)], np.int32))
    likelihood.observe(cloud(grid, surface, count))
    return likelihood, likelihood.points.get()


@pytest.mark.parametrize("term", ["edge", "silhouette"])
@pytest.mark.parametrize(
    ("name", "views", "n_particles"), [("song31", 1, 2), ("song31", 5, 129), ("stick", 5, 37)]
)
def test_image_terms_agree_with_the_twin(
    device: Device, name: str, views: int, term: str, n_particles: int
) -> None:
    """Equal but for samples that rounding moves over a pixel's or the picture's border."""
    body, rig = bodies.named(name), scenes.ring(views)
    setup = Setup(
        device, body, rig, bodies.scattered_poses(body, n_particles), smooth_maps(rig), only(term)
    )
    found, expected = setup.errors() / views, setup.expected(NO_POINTS) / views
    np.testing.assert_allclose(found, expected, atol=0.02)
    assert np.mean(np.abs(found - expected) < 1e-3) > 0.9
    if n_particles > 2:
        assert np.ptp(expected) > 0.1


@pytest.mark.parametrize("term", ["edge", "silhouette"])
@pytest.mark.parametrize("ends", [(-0.5, 0.5), (0.5, -0.5), (-0.5, 2.5)])
def test_axis_pointing_at_the_camera(device: Device, ends: tuple[float, float], term: str) -> None:
    """All four corners on one line in the picture: a diameter is sampled, nothing breaks. A cone
    through the camera has no image."""
    stick = bodies.named("stick")
    cone = replace(
        stick.cones[2],
        start=np.array([ends[0], 0, -0.05]),
        end=np.array([ends[1], 0, -0.05]),
        radii=(0.05, 0.1),
        in_images=True,
    )
    body = replace(stick, cones=(cone,), apart=())
    rig = CameraRig((FRONT,))
    poses = bodies.random_poses(body, 3)
    setup = Setup(device, body, rig, poses, smooth_maps(rig), only(term))
    np.testing.assert_allclose(setup.errors(), setup.expected(NO_POINTS), atol=0.03)
    assert (setup.errors() == 1).all() == (ends[1] == 2.5)


def test_many_cameras_are_taken_in_turns(device: Device) -> None:
    """As many as local memory has room for; a body that has no room at all is refused."""
    body, rig = bodies.named("song31"), scenes.ring(32)
    poses = bodies.random_poses(body, 11)
    setup = Setup(device, body, rig, poses, smooth_maps(rig), CONFIG)
    np.testing.assert_allclose(setup.errors(), setup.expected(NO_POINTS), rtol=0.01)
    crowd = replace(body, cones=body.cones * 1000)
    with pytest.raises(InputError, match="bytes of local memory; expected at most"):
        Setup(device, crowd, rig, poses, setup.maps, CONFIG)


@pytest.mark.parity("tracking/surface_samples.sample_surface")
@pytest.mark.parametrize("n_voxels", [0, 1, 99, 100, 101, 2345])
def test_surface_samples_agree_with_the_twin(device: Device, n_voxels: int) -> None:
    body, grid = bodies.named("stick"), VoxelGrid(np.array([-0.3, 0.2, -0.1]), 0.07, (11, 17, 23))
    random = np.random.default_rng(n_voxels)
    indices = np.sort(random.choice(grid.size, n_voxels, replace=False)).astype(np.int32)
    _, points = point_sampler(device, body, grid, indices, 100)
    expected = sampled_surface(grid.centres(indices), 100)
    if n_voxels == 0:
        assert not points.any()
    else:
        np.testing.assert_allclose(points[:, :3], expected, atol=1e-6)
        assert np.all(points[:, 3] == 1)


@pytest.mark.parametrize(
    ("name", "n_voxels", "n_points"),
    [("song31", 0, 63), ("song31", 2000, 1024), ("stick", 1, 63), ("stick", 50, 1)],
)
def test_surface_kernel_agrees_with_the_twin(
    device: Device, name: str, n_voxels: int, n_points: int
) -> None:
    body, grid = bodies.named(name), VoxelGrid(np.array([-0.9, -0.8, -0.1]), 0.1, (18, 17, 19))
    random = np.random.default_rng(n_voxels)
    indices = np.sort(random.choice(grid.size, n_voxels, replace=False)).astype(np.int32)
    rig = scenes.ring(1)
    poses = bodies.random_poses(body, 37, wild=True)
    config = only("surface", n_points=n_points)
    setup = Setup(device, body, rig, poses, smooth_maps(rig), config, grid)
    setup.likelihood.points.set(point_sampler(device, body, grid, indices, n_points)[1])
    points = sampled_surface(grid.centres(indices), n_points)
    for turn in (0, 2, 5):
        np.testing.assert_allclose(setup.errors(turn), setup.expected(points, turn), atol=1e-4)


@pytest.mark.parity("tracking/likelihood.score_poses")
@pytest.mark.parametrize(
    ("name", "views", "weights"),
    [("song31", 5, {}), ("song31", 1, {"surface_weight": 0.0}), ("stick", 5, {})],
)
def test_totals_agree_with_the_twin(device: Device, name: str, views: int, weights: dict) -> None:
    body, rig = bodies.named(name), scenes.ring(views)
    config = CONFIG.with_changes(**weights)
    grid = scenes.small_grid(0.1)
    indices = np.arange(0, grid.size, 7, dtype=np.int32)
    poses = bodies.scattered_poses(body, 37)
    poses[-1, [axis[-3:] == ".tz" for axis in body.dof_names]] = 1000  # out of every picture
    setup = Setup(device, body, rig, poses, smooth_maps(rig), config, grid)
    count = device.to_device(np.array([len(indices)], np.int32))
    setup.likelihood.observe(cloud(grid, device.to_device(indices), count))
    found = setup.errors()
    expected = setup.expected(sampled_surface(grid.centres(indices), config.likelihood.n_points))
    assert np.isfinite(found).all()
    close = np.abs(found - expected) < 1e-3 * (1 + expected)
    assert close.mean() > 0.9
    np.testing.assert_allclose(found, expected, rtol=0.03)
    weights = config.likelihood
    worst = weights.edge_weight + weights.silhouette_weight
    assert found[-1] >= views * worst * (1 - 1e-6) or name == "stick"  # which has no such axis


def test_misfit_is_silhouette_and_surface_error_of_one_pose(device: Device) -> None:
    body, rig, grid = bodies.named("song31"), scenes.ring(5), scenes.small_grid(0.1)
    indices = np.arange(0, grid.size, 7, dtype=np.int32)
    poses = bodies.scattered_poses(body, 3)
    setup = Setup(device, body, rig, poses, smooth_maps(rig), CONFIG, grid)
    count = device.to_device(np.array([len(indices)], np.int32))
    setup.likelihood.observe(cloud(grid, device.to_device(indices), count))
    setup.errors()
    for launch in setup.likelihood.misfit_launcher(setup.on_device):
        launch()
    config = CONFIG.likelihood
    points = sampled_surface(grid.centres(indices), config.n_points)
    seen = FrameEvidence(setup.maps, points)
    expected = sum(
        total_errors(
            rig,
            posed_cones(body, setup.poses[:1]),
            seen,
            choose_cone_sampling(body),
            (),
            only(term).likelihood,
        )[0]
        / len(rig)
        for term in ("silhouette", "surface")
    )
    assert setup.likelihood.misfits.get()[0] == pytest.approx(expected, rel=2e-3)


def test_overlap_kernel_agrees_where_parts_meet(device: Device) -> None:
    body, rig = bodies.named("song31"), scenes.ring(1)
    poses = bodies.random_poses(body, 129, wild=True)
    setup = Setup(device, body, rig, poses, smooth_maps(rig), only("overlap"))
    expected = setup.expected(NO_POINTS)
    assert (expected > 0.02).mean() > 0.1 and (expected == 0).any()
    np.testing.assert_allclose(setup.errors(), expected, atol=1e-5)


@pytest.mark.parametrize("name", ["song32", "stick"])
@pytest.mark.parametrize("n", [2, 37, 129])
def test_posture_kernel_agrees(device: Device, name: str, n: int) -> None:
    body, rig = bodies.named(name), scenes.ring(3)
    setup = Setup(
        device, body, rig, bodies.random_poses(body, n, wild=True), smooth_maps(rig),
        only("posture"),
    )  # fmt: skip
    expected = setup.expected(NO_POINTS)
    assert (expected > 1).any() == (name == "song32")  # the stick has no posture
    np.testing.assert_allclose(setup.errors(), expected, rtol=1e-4, atol=1e-6)
