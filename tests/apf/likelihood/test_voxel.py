"""Errors of particles: what the twin says of known cases, and the kernels against the twin."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.likelihoods import CONFIG, FRONT, Setup, only

from apf.body.cones import overlap_errors
from apf.body.kinematics import posed_cones
from apf.body.limbs import find_hands
from apf.body.model import BodyModel
from apf.body.stature import stature
from apf.filters.config import FilterConfig
from apf.initialisation.load import add_load
from apf.likelihood.config import LikelihoodConfig
from apf.likelihood.voxel import VoxelLikelihood, choose_cone_sampling
from apf.reference.likelihood.voxel import (
    FrameEvidence,
    image_errors,
    posture_errors,
    sampled_surface,
    surface_errors,
    total_errors,
)
from apf.scene import Scene
from cl import Device, InputError
from psfs.cameras.camera import Camera, CameraRig
from psfs.common.cones import CONE_FLOATS
from psfs.voxels.grid import VoxelGrid

SONG = bodies.named("song31")
NO_POINTS = np.empty((0, 3))
#: Bodies, cameras and poses of the images' terms.
IMAGE_ROWS = [("song31", 1, 2), ("song31", 5, 129), ("stick", 5, 37)]


def point_sampler(
    device: Device, body: BodyModel, grid: VoxelGrid, indices: np.ndarray, n_points: int
) -> tuple[VoxelLikelihood, np.ndarray]:
    """A likelihood that has sampled the surface voxels `indices`; its points (n_points, 4)."""
    config = CONFIG.with_changes(n_points=n_points).likelihood
    likelihood = VoxelLikelihood(Scene(device, scenes.ring(1), grid, body), config, 2)
    likelihood.observe(scenes.voxels_at(device, grid, indices))
    return likelihood, likelihood.points.get()


@pytest.mark.parametrize(
    ("term", "name", "views", "n"),
    [
        *(("edge", *row) for row in IMAGE_ROWS),
        *(("silhouette", *row) for row in IMAGE_ROWS),
        ("overlap", "song31", 1, 129),
        *(("posture", name, 3, n) for name, n in (("song31", 37), ("song31", 129), ("stick", 2))),
    ],
)
def test_terms_agree_with_twins(device: Device, term: str, name: str, views: int, n: int) -> None:
    """Those of images are equal but for samples that rounding moves over a pixel's or the picture's
    border."""
    body, of_images = bodies.named(name), term in ("edge", "silhouette")
    poses = (
        bodies.scattered_poses(body, n) if of_images else bodies.random_poses(body, n, wild=True)
    )
    setup = Setup(device, body, scenes.ring(views), poses, only(term))
    found, expected = setup.errors() / views, setup.expected(NO_POINTS) / views
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=0.02 if of_images else 1e-5)
    assert np.isclose(found, expected, rtol=1e-4, atol=1e-3).mean() > 0.9
    assert (np.ptp(expected) > 0.1) or n == 2
    assert (expected == 0).all() == (term == "posture" and name == "stick")  # which has none


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
    setup = Setup(device, body, CameraRig((FRONT,)), bodies.random_poses(body, 3), only(term))
    np.testing.assert_allclose(setup.errors(), setup.expected(NO_POINTS), atol=0.03)
    assert (setup.errors() == 1).all() == (ends[1] == 2.5)


def test_many_cameras_are_taken_in_turns(device: Device) -> None:
    """As many as local memory has room for; a body that has no room at all is refused."""
    body, rig = bodies.named("song31"), scenes.ring(32)
    poses = bodies.random_poses(body, 11)
    setup = Setup(device, body, rig, poses, CONFIG)
    np.testing.assert_allclose(setup.errors(), setup.expected(NO_POINTS), rtol=0.01)
    crowd = replace(body, cones=body.cones * 1000)
    with pytest.raises(InputError, match="bytes of local memory; expected at most"):
        Setup(device, crowd, rig, poses, CONFIG)


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
def test_surface_kernel_and_twin(device: Device, name: str, n_voxels: int, n_points: int) -> None:
    body, grid = bodies.named(name), VoxelGrid(np.array([-0.9, -0.8, -0.1]), 0.1, (18, 17, 19))
    random = np.random.default_rng(n_voxels)
    indices = np.sort(random.choice(grid.size, n_voxels, replace=False)).astype(np.int32)
    poses = bodies.random_poses(body, 37, wild=True)
    setup = Setup(device, body, scenes.ring(1), poses, only("surface", n_points=n_points), grid)
    setup.likelihood.points.set(point_sampler(device, body, grid, indices, n_points)[1])
    points = sampled_surface(grid.centres(indices), n_points)
    for turn in (0, 2, 5):
        np.testing.assert_allclose(setup.errors(turn), setup.expected(points, turn), atol=1e-4)


def observed(
    device: Device, body: BodyModel, views: int, poses: np.ndarray, config: FilterConfig
) -> tuple[Setup, np.ndarray]:
    """A likelihood that has sampled the surface of every seventh voxel; the points by the twin."""
    grid = scenes.small_grid(0.1)
    indices = np.arange(0, grid.size, 7, dtype=np.int32)
    setup = Setup(device, body, scenes.ring(views), poses, config, grid)
    setup.likelihood.observe(scenes.voxels_at(device, grid, indices))
    return setup, sampled_surface(grid.centres(indices), config.likelihood.n_points)


@pytest.mark.parity("tracking/likelihood.score_poses")
@pytest.mark.parametrize(
    ("name", "views", "weights"),
    [("song31", 5, {}), ("song31", 1, {"surface_weight": 0.0}), ("stick", 5, {})],
)
def test_totals_agree_with_the_twin(device: Device, name: str, views: int, weights: dict) -> None:
    body = bodies.named(name)
    poses = bodies.scattered_poses(body, 37)
    poses[-1, [axis[-3:] == ".tz" for axis in body.dof_names]] = 1000  # out of every picture
    setup, points = observed(device, body, views, poses, CONFIG.with_changes(**weights))
    found, expected = setup.errors(), setup.expected(points)
    assert np.isfinite(found).all()
    close = np.abs(found - expected) < 1e-3 * (1 + expected)
    assert close.mean() > 0.9
    np.testing.assert_allclose(found, expected, rtol=0.03)
    worst = setup.config.edge_weight + setup.config.silhouette_weight
    assert found[-1] >= views * worst * (1 - 1e-6) or name == "stick"  # which has no such axis


def test_misfit_is_silhouette_and_surface_error_of_one_pose(device: Device) -> None:
    setup, points = observed(device, SONG, 5, bodies.scattered_poses(SONG, 3), CONFIG)
    setup.errors()
    for launch in setup.likelihood.misfit_launcher(setup.on_device):
        launch()
    cones, seen = posed_cones(SONG, setup.poses[:1]), FrameEvidence(setup.maps, points)
    given = (setup.rig, cones, seen, choose_cone_sampling(SONG), ())
    both = (only(term).likelihood for term in ("silhouette", "surface"))
    expected = sum(total_errors(*given, weights)[0] / 5 for weights in both)
    assert setup.likelihood.misfits.get()[0] == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize(("ahead", "hands"), [(0.4, 2), (-0.3, 0)])
def test_hands_hold_what_is_before_the_trunk(device: Device, ahead: float, hands: int) -> None:
    """Both hands from below or beside; none holds what is on the back."""
    ends = np.array([[ahead, 0.1, 0.1], [ahead, 0.1, 0.3]])
    parts = [
        replace(SONG.cones[0], name=f"load_{k}", bone=0, start=start, end=end)
        for k, (start, end) in enumerate([ends, ends * (1, -1, 1)])
    ]
    loaded = add_load(SONG, parts, stature(SONG))
    assert len(find_hands(loaded)) == hands and not find_hands(SONG)
    poses = bodies.random_poses(SONG, 37, wild=True)
    setup = Setup(device, loaded, scenes.ring(2), poses, only("none"))
    expected = setup.expected(NO_POINTS)
    assert (np.ptp(expected) > 0.4) == (hands > 0)
    np.testing.assert_allclose(setup.errors(), expected, atol=1e-4)


def card(corners: list, width: float) -> np.ndarray:
    """A round cone (1, 1, CONE_FLOATS) between two corners."""
    return bodies.cone(*corners, (width / 2, width / 2), [0, 1, 0])[None, None]


UPRIGHT = card([[0, 0, -0.4], [0, 0, 0.4]], 0.2)


def test_a_card_costs_the_share_that_hangs_over_its_silhouette() -> None:
    maps = np.zeros((121, 101, 2), np.uint8)
    maps[20:101, 40:61, 0] = 255
    maps[:, [40, 60], 1] = 255
    sums = image_errors(FRONT, UPRIGHT, maps, np.array([[8, 5]]))[0, 0]
    assert sums.tolist() == [0, 16, 0, 40]
    maps[..., 0] = 0
    maps[:, 50:, 0] = 255  # half the picture
    maps[..., 1] = 51  # a fifth everywhere
    sums = image_errors(FRONT, UPRIGHT, maps, np.array([[10, 4]]))[0, 0]
    np.testing.assert_allclose(sums, [0.8 * 20, 20, 0.5 * 40, 40])


def test_samples_outside_the_picture_do_not_count() -> None:
    maps = np.zeros((121, 101, 2), np.uint8)
    half_out = card([[0, 0, 0], [0, 0, 1.2]], 0.2)  # ends 60 px above the upper border
    sums = image_errors(FRONT, half_out, maps, np.array([[12, 5]]))[0, 0]
    np.testing.assert_allclose(sums, [12, 12, 30, 30])
    wide = card([[0, 0, -0.4], [0, 0, 0.4]], 1.2)  # both outlines out, the inside partly
    sums = image_errors(FRONT, wide, maps, np.array([[4, 12]]))[0, 0]
    np.testing.assert_allclose(sums, [0, 0, 40, 40])
    away = card([[0, 3, 0], [0, 3, 1]], 0.1)
    behind = card([[3, 0, 0], [3, 0, 1]], 0.1)
    for cones in (away, behind):
        assert not image_errors(FRONT, cones, maps, np.array([[6, 5]])).any()


def test_surface_error_is_a_half_at_its_scale() -> None:
    cones = np.concatenate([UPRIGHT, UPRIGHT + np.eye(1, CONE_FLOATS)])  # the second leans away
    near = np.array([[0.1, 0, 0.0], [0.0, -0.1, 0.3]])
    np.testing.assert_allclose(surface_errors(near, UPRIGHT, 0.05), [0], atol=1e-12)
    assert surface_errors(near, cones, 0.05)[1] > 0.5
    at_scale = np.array([[0.15, 0, 0.0], [0.05, 0, 0]])  # outside and inside alike
    np.testing.assert_allclose(surface_errors(at_scale, UPRIGHT, 0.05), [0.5])
    far = np.array([[9.0, 0, 0]])
    assert 0.999 < surface_errors(far, UPRIGHT, 0.05)[0] < 1
    np.testing.assert_array_equal(surface_errors(near[:0], cones, 0.05), [1, 1])
    centres = np.arange(30.0).reshape(10, 3)
    np.testing.assert_array_equal(sampled_surface(centres, 10), centres)
    np.testing.assert_array_equal(sampled_surface(centres, 5), centres[::2])
    counts = np.bincount((sampled_surface(centres, 25)[:, 0] / 3).astype(int))
    assert len(counts) == 10 and set(counts) == {2, 3}
    assert sampled_surface(centres[:0], 5).shape == (0, 3)


def test_overlap_of_parts() -> None:
    """Parallel cylinders of radius 0.1: free apart from 0.2 on, worst on each other's axes."""
    pairs = [(0, 1)]
    overlap = []
    for gap in (0.0, 0.1, 0.15, 0.2, 0.5):
        second = card([[0, gap, -0.4], [0, gap, 0.4]], 0.2)
        overlap.append(overlap_errors(np.concatenate([UPRIGHT, second], 1), pairs)[0])
    # The distance to the second's surface over the first's radius, from 1 on nothing.
    np.testing.assert_allclose(overlap, [1, 1, 0.25, 0, 0], atol=1e-12)
    cones = np.concatenate([UPRIGHT, UPRIGHT, card([[0, 5, 0], [0, 5, 1]], 0.2)], 1)
    np.testing.assert_allclose(overlap_errors(cones, [(0, 1), (0, 2)]), [0.5])
    np.testing.assert_array_equal(overlap_errors(cones, []), [0])


def test_cameras_that_see_nothing_are_replaced_by_the_others() -> None:
    body_pairs: list[tuple[int, int]] = []
    config = LikelihoodConfig()
    turned = replace(FRONT, name="away", R=FRONT.R * [[-1], [1], [-1]], t=np.array([0, 0, -2.0]))
    maps = np.full((2, 121, 101, 2), 51, np.uint8)
    points, sampling = np.array([[0.15, 0, 0.0]]), np.array([[8, 5]])

    def errors(*cameras: Camera, cones: np.ndarray = UPRIGHT) -> float:
        rig = CameraRig(cameras)
        arguments = (FrameEvidence(maps[: len(rig)], points), sampling, body_pairs, config)
        return float(total_errors(rig, cones, *arguments)[0])

    image = 0.8 * (config.edge_weight + config.silhouette_weight)
    surface = 0.5 * config.surface_weight
    assert errors(FRONT) == pytest.approx(image + surface)
    assert errors(FRONT, turned) == pytest.approx(2 * (image + surface))
    worst = config.edge_weight + config.silhouette_weight
    assert errors(turned) == pytest.approx(worst + surface)


def test_posture_error_counts_sigmas_from_rest() -> None:
    bound = np.flatnonzero(np.isfinite(SONG.posture_sigma))
    poses = np.tile(SONG.rest_pose, (3, 1))
    poses[1, bound[0]] += 2 * SONG.posture_sigma[bound[0]]
    poses[2, bound[:2]] -= SONG.posture_sigma[bound[:2]]
    poses[:, np.isinf(SONG.posture_sigma)] += 5.0  # no value is likelier
    np.testing.assert_allclose(posture_errors(SONG, poses), [0, 4, 2], atol=1e-12)
