"""Errors of particles: the twin against known answers."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.likelihoods import FRONT

from apf.body.cones import overlap_errors
from apf.body.kinematics import posed_cones
from apf.likelihood.config import LikelihoodConfig
from apf.likelihood.voxel import choose_cone_sampling
from apf.reference.likelihood.voxel import (
    FrameEvidence,
    image_errors,
    posture_errors,
    sampled_surface,
    subset,
    surface_errors,
    total_errors,
)
from cl import NumpyDevice
from psfs.cameras.camera import Camera, CameraRig
from psfs.common.cones import CONE_FLOATS, cone_distances
from psfs.reference.reprojection import NumpyReprojection
from psfs.reference.surface import surface_voxels
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.host_voxels import HostVoxels


def card(corners: list, width: float) -> np.ndarray:
    """A round cone (1, 1, CONE_FLOATS) between two corners."""
    row = np.zeros(CONE_FLOATS)
    row[0:3], row[4:7], row[3], row[7] = *corners, width / 2, width / 2
    row[8:11], row[12:15] = [0, 1, 0], [-1, 0, 0]
    return row[None, None]


UPRIGHT = card([[0, 0, -0.4], [0, 0, 0.4]], 0.2)


def test_a_card_that_fits_its_silhouette_costs_nothing() -> None:
    maps = np.zeros((121, 101, 2), np.uint8)
    maps[20:101, 40:61, 0] = 255
    maps[:, [40, 60], 1] = 255
    ((edge, n_edge, inner, n_inner),) = image_errors(FRONT, UPRIGHT, maps, np.array([[8, 5]]))[0]
    assert (edge, n_edge, inner, n_inner) == (0, 16, 0, 40)


def test_a_card_beside_its_silhouette_costs_the_share_that_hangs_over() -> None:
    maps = np.zeros((121, 101, 2), np.uint8)
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


def test_surface_points_are_spread_evenly() -> None:
    centres = np.arange(30.0).reshape(10, 3)
    np.testing.assert_array_equal(sampled_surface(centres, 10), centres)
    np.testing.assert_array_equal(sampled_surface(centres, 5), centres[::2])
    counts = np.bincount((sampled_surface(centres, 25)[:, 0] / 3).astype(int))
    assert len(counts) == 10 and set(counts) == {2, 3}
    assert sampled_surface(centres[:0], 5).shape == (0, 3)


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


def test_the_weights_of_the_settings_weigh() -> None:
    rig, points = CameraRig((FRONT,)), np.array([[0.15, 0, 0.0]])
    cones = np.concatenate([UPRIGHT, UPRIGHT], 1)
    maps = np.zeros((1, 121, 101, 2), np.uint8)
    maps[..., 0], maps[..., 1] = 204, 51
    expected = {"edge": 0.8, "silhouette": 0.2, "surface": 0.5, "overlap": 1.0}
    for name, value in expected.items():
        weights: Any = {f"{other}_weight": 0.0 for other in expected} | {f"{name}_weight": 3.0}
        config = LikelihoodConfig(**weights)
        sampling = np.array([[8, 5], [8, 5]])
        found = total_errors(rig, cones, FrameEvidence(maps, points), sampling, [(0, 1)], config)
        np.testing.assert_allclose(found, [3 * value], err_msg=name)


@pytest.mark.parametrize("song_alone", [False, True])
def test_the_true_pose_has_the_least_error(song_alone: bool) -> None:
    """Voxels of a known pose: it beats its neighbours, far poses lose most (sign of eq. 16)."""
    body, rig = bodies.named("song31"), scenes.ring(4, size=(193, 151))
    alone = {"surface_weight": 0.0, "overlap_weight": 0.0}
    config = LikelihoodConfig(**alone) if song_alone else LikelihoodConfig()  # type: ignore[arg-type]
    grid = VoxelGrid.covering(np.array([-0.7, -0.7, -0.1]), np.array([0.7, 0.7, 1.9]), 0.03)
    truth = body.rest_pose
    inside = cone_distances(grid.centres(), posed_cones(body, truth[None])[0]).min(1) < 0
    occupied = inside.reshape(grid.shape)
    voxels = HostVoxels(grid, occupied.astype(float), surface_voxels(occupied), 0)
    maps = NumpyReprojection(NumpyDevice(), rig, grid)(voxels)
    points = sampled_surface(voxels.cloud().centres, config.n_points)
    steps = np.random.default_rng(0).normal(0, 1, (30, body.n_dof)) * body.sigma
    poses = np.clip(
        truth + np.concatenate([0 * steps[:1], 3 * steps, 12 * steps]), body.lower, body.upper
    )
    seen, sampling = FrameEvidence(maps, points), choose_cone_sampling(body, 0.04)
    errors = total_errors(rig, posed_cones(body, poses), seen, sampling, body.apart, config)
    assert errors[0] == errors.min()
    assert errors[0] < np.median(errors[1:31]) < np.median(errors[31:])


def test_shares_of_the_surface_are_every_so_many() -> None:
    points = np.arange(30.0).reshape(10, 3)
    parts = [subset(points, turn, 4) for turn in range(4)]
    np.testing.assert_array_equal(parts[1], points[[1, 5, 9]])
    np.testing.assert_array_equal(parts[2], points[[2, 6, 0]])  # all of the same size
    np.testing.assert_array_equal(subset(points, 6, 4), parts[2])
    np.testing.assert_array_equal(subset(points, 3, 1), points)
    assert subset(points[:0], 1, 4).shape == (0, 3) and subset(points[:1], 3, 4).shape == (1, 3)


def test_posture_error_counts_sigmas_from_rest() -> None:
    body = bodies.named("song31")
    bound = np.flatnonzero(np.isfinite(body.posture_sigma))
    poses = np.tile(body.rest_pose, (3, 1))
    poses[1, bound[0]] += 2 * body.posture_sigma[bound[0]]
    poses[2, bound[:2]] -= body.posture_sigma[bound[:2]]
    poses[:, np.isinf(body.posture_sigma)] += 5.0  # no value is likelier
    np.testing.assert_allclose(posture_errors(body, poses), [0, 4, 2], atol=1e-12)


def test_the_clavicle_that_fits_best_rises_with_the_arm() -> None:
    body = bodies.named("song32")
    clavicle, arm = (body.dof_names.index(f"r_{name}.rx") for name in ("clavicle", "upper_arm"))
    angles = np.linspace(0, 0.5, 501)
    best = []
    for lifted in (0.0, np.pi / 2, 2.6):  # relative to the clavicle, whose rise adds to it
        poses = np.tile(body.rest_pose, (len(angles), 1))
        poses[:, clavicle], poses[:, arm] = angles, lifted
        best.append(angles[posture_errors(body, poses).argmin()])
    assert best[0] == 0 and 0.02 < best[1] < 0.05 and 0.4 < best[2] < 0.45
