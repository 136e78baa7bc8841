"""Silhouette recall, and its kernels against the twin."""

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.kinds import other_kind
from helpers.likelihoods import Setup, only
from helpers.parity import traced

from apf.body.cones import project_outlines
from apf.body.kinematics import posed_cones
from apf.body.toml import load_body
from apf.reference.likelihood.part_colour import is_in_outline
from apf.reference.likelihood.voxel import sampled_surface, uncovered_errors
from cl import Device
from psfs.voxels.grid import VoxelGrid

SONG = load_body("song31")


def test_inside_of_a_trapezoid_either_way_round() -> None:
    square = np.array([[0.0, 0], [4, 0], [4, 2], [0, 2]])
    nothing = np.full((4, 2), np.nan)
    pixels = np.array([[1.0, 1], [3.9, 1.9], [4.1, 1], [-1, 1], [2, 3]])
    inside = [True, True, False, False, False]
    for quad in (square, square[::-1]):
        covered = is_in_outline(np.stack([quad, nothing]), pixels[:, None])
        assert covered.T.tolist() == [inside, [False] * len(pixels)]


def test_a_hidden_leg_costs_what_it_leaves_uncovered() -> None:
    """Both legs in one leg's silhouette: precision sees nothing amiss, recall does."""
    rig = scenes.ring(4)
    pose = bodies.bent(SONG, l_thigh__ry=-0.5)
    cones = posed_cones(SONG, np.stack([pose, SONG.rest_pose]))
    random = np.random.default_rng(0)
    t = random.uniform(0, 1, (4000, 1))
    of = cones[0][random.integers(len(SONG.cones), size=4000)]
    axis_points = of[:, 0:3] + t * (of[:, 4:7] - of[:, 0:3])
    whole, half = uncovered_errors(rig, cones, axis_points)
    assert whole < 0.02 and half > whole + 0.05


@pytest.mark.parity("tracking/likelihood.score_poses")
@pytest.mark.parametrize(
    ("kind", "views", "n_voxels"),
    [("own", 5, 900), ("own", 1, 0), ("own", 5, 1), ("other", 3, 900)],
)
def test_kernels_agree_with_the_twin(device: Device, kind: str, views: int, n_voxels: int) -> None:
    """Points on the very edge of a trapezoid may fall either way. GPUs look at several samples of
    several cameras together, CPUs at several poses."""
    device = device if kind == "own" else other_kind(device)
    body, rig, grid = SONG, scenes.ring(views), scenes.small_grid(0.1)
    indices = np.arange(n_voxels, dtype=np.int32) * max(1, grid.size // 1000)
    poses = bodies.scattered_poses(body, 23)
    config = only("none").with_changes(silhouette_recall_weight=1.5, n_points=300, point_turns=2)
    setup = Setup(device, body, rig, poses, config, grid)
    setup.likelihood.observe(scenes.voxels_at(device, grid, indices))
    points = sampled_surface(grid.centres(indices), 300)
    for turn in (0, 1):
        found = setup.errors(turn) / views
        expected = setup.expected(points, turn) / views
        assert np.abs(found - expected).max() <= 1.5 * 4 / 150
        assert np.mean(np.abs(found - expected) < 1e-4) > 0.6
    assert np.isfinite(project_outlines(rig[0], posed_cones(body, poses))).any()


@pytest.mark.parity("tracking/surface_samples.sample_surface")
@pytest.mark.parametrize(("views", "n_points"), [(1, 1), (5, 300)])
def test_projected_points_agree_with_the_twin(device: Device, views: int, n_points: int) -> None:
    """A point on a picture's border may count as in or out."""
    rig, grid = scenes.ring(views), VoxelGrid.covering(np.full(3, -4.0), np.full(3, 4.0), 0.3)
    config = only("none").with_changes(silhouette_recall_weight=1.5, n_points=n_points)
    poses = bodies.scattered_poses(SONG, 2)
    setup = Setup(device, SONG, rig, poses, config, grid)
    indices = np.sort(np.random.default_rng(views).choice(grid.size, 999, replace=False))
    with traced("tracking/surface_samples.sample_surface") as launches:
        setup.likelihood.observe(scenes.voxels_at(device, grid, indices))
    found = launches[0].after["pixels"].reshape(views, n_points, 2)
    points = sampled_surface(grid.centres(indices), n_points)
    for camera, pixels in zip(rig, found, strict=True):
        expected, depth = camera.project(points)
        end = np.array(camera.size) - 0.5
        inside = (depth > 0) & (expected >= -0.5).all(1) & (expected < end).all(1)
        border = np.abs(expected + 0.5).min(1) < 1e-3
        border |= np.abs(expected - end).min(1) < 1e-3
        assert ((pixels > -1e5).all(1) == inside)[~border].all()
        both = inside & ~border
        np.testing.assert_allclose(pixels[both], expected[both], atol=1e-3)
        assert (both.any() and not both.all()) or n_points == 1
