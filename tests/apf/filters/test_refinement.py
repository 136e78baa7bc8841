"""Gauss-Newton refinement: convergence, and the kernel against the twin."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.kinds import other_kind, skipped_without_room
from helpers.sightings import seen_points

from apf.body.jacobian import distance_jacobian
from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.body.toml import load_body
from apf.filters.config import VOXEL_SCALE, FilterConfig, GaussNewtonFit
from apf.filters.refinement import VOXEL_STRENGTH, Refinement, prior_deviation
from apf.likelihood.observations import ObservedPoints, PointObservations, make_empty_observations
from apf.reference.filters.refinement import refine
from apf.scene import Scene
from cl import Device

SONG = load_body("song31")
CONFIG = FilterConfig.create(n_points=300)
#: Without a prior that is worth mentioning.
FREE = GaussNewtonFit(steps=8, width=100.0, point_reach=10.0)
USUAL = GaussNewtonFit(steps=3, width=4.0, point_reach=10.0)


def on_device(
    device: Device,
    body: BodyModel,
    mean: np.ndarray,
    voxels: np.ndarray,
    config: FilterConfig = CONFIG,
    fit: GaussNewtonFit = FREE,
    seen: PointObservations | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Refined pose and information by the kernel, by what the cameras of `RIG` have seen and by
    voxels; none at all count as an empty cloud if nothing else is seen."""
    observed = None
    if seen is not None:
        observed = ObservedPoints(Scene(device, RIG, None, body), 300)
        observed.set(seen)
    by_voxels = seen is None or len(voxels) > 0
    padded = np.zeros((config.likelihood.n_points, 4), np.float32)
    if len(voxels):
        padded[:] = np.c_[voxels, np.ones(len(voxels))]
    refinement = Refinement(device, body, config, voxels=by_voxels, observed=observed, fit=fit)
    result = device.to_device(mean.astype(np.float32))
    for launch in refinement.launcher(device.to_device(padded) if by_voxels else None, result):
        launch()
    return result.get(), refinement.information.get()[0]


def assert_close(
    found: tuple[np.ndarray, np.ndarray], expected: tuple[np.ndarray, np.ndarray], atol: float
) -> None:
    """The kernel's pose and lower triangle of the information are the twin's."""
    np.testing.assert_allclose(found[0], expected[0], atol=atol)
    scale = np.sqrt(np.outer(np.diag(expected[1]), np.diag(expected[1])))
    lower = np.tril_indices(len(scale))
    np.testing.assert_allclose(found[1] / scale[lower], (expected[1] / scale)[lower], atol=0.02)


def miss(body: BodyModel, pose: np.ndarray, true: np.ndarray) -> float:
    """The joints' mean distance, m, from those of the true pose."""
    found, expected = posed_joints(body, np.stack([pose, true]))
    return float(np.linalg.norm(found - expected, axis=-1).mean())


def test_finds_the_way_back_and_is_never_worse_than_the_mean() -> None:
    pose = bodies.random_poses(SONG, 1)[0]
    points = bodies.surface_points(SONG, pose, 600)
    moved = pose + np.random.default_rng(0).normal(0, 2, SONG.n_dof) * SONG.sigma
    moved = np.clip(moved, SONG.lower, SONG.upper)
    found = refine(SONG, moved, points, CONFIG, fit=FREE)[0]
    assert miss(SONG, found, pose) < 0.2 * miss(SONG, moved, pose)
    assert np.all((found >= SONG.lower) & (found <= SONG.upper))
    points = np.random.default_rng(1).normal(0, 1, (300, 3))  # nothing like a body

    def cost(other: np.ndarray) -> float:
        distance = distance_jacobian(SONG, other, points)[0]
        share = np.mean(distance**2 / (distance**2 + VOXEL_SCALE**2))
        away = np.sum(((other - pose) / prior_deviation(SONG, CONFIG, FREE)) ** 2)
        return float(VOXEL_STRENGTH * share + away)

    assert cost(refine(SONG, pose, points, CONFIG, fit=FREE)[0]) <= cost(pose)


@pytest.mark.parity("tracking/refinement.refine_system", "tracking/refinement.refine_end")
@pytest.mark.parametrize("name", ["song31", "stick"])
@pytest.mark.parametrize("n_points", [1, 37, 300])
def test_kernel_and_twin(device: Device, name: str, n_points: int) -> None:
    body = bodies.named(name)
    config = CONFIG.with_changes(n_points=n_points)
    pose = bodies.random_poses(body, 1)[0]
    random = np.random.default_rng(n_points)
    points = bodies.surface_points(body, pose, n_points) + random.normal(0, 0.01, (n_points, 3))
    mean = np.clip(pose + random.normal(0, 1, body.n_dof) * body.sigma, body.lower, body.upper)
    refined = on_device(device, body, mean, points, config, USUAL)
    assert_close(refined, refine(body, mean, points, config, fit=USUAL), 2e-4)


def test_several_poses_at_once(device: Device) -> None:
    """Each is refined as if it were alone."""
    poses = bodies.random_poses(SONG, 3).astype(np.float32)
    points = bodies.surface_points(SONG, poses[1].astype(float), 300)
    padded = np.c_[points, np.ones(300)].astype(np.float32)
    refinement, found = Refinement(device, SONG, CONFIG, 3, fit=FREE), device.to_device(poses)
    for launch in refinement.launcher(device.to_device(padded), found):
        launch()
    for k, pose in enumerate(poses):
        alone, information = on_device(device, SONG, pose, points, CONFIG)
        np.testing.assert_array_equal(found.get()[k], alone)
        np.testing.assert_array_equal(refinement.information.get()[k], information)


RIG = scenes.ring(3, size=(640, 480))


def test_finds_the_way_back_by_what_cameras_see() -> None:
    """Of which a tenth is wrong and another tenth the other side's."""
    body, random = load_body("song31"), np.random.default_rng(3)
    pose = bodies.random_poses(body, 1)[0]
    seen = seen_points(body, pose, RIG, 60)
    swapped = seen_points(body, pose, RIG, 60, as_partners=True)
    assert len(swapped) == len(seen)
    kind = random.random(len(seen))[:, None]
    wrong = random.uniform(0, 500, (len(seen), 2))
    pixel = np.where(kind < 0.1, wrong, np.where(kind < 0.2, swapped.pixel, seen.pixel))
    seen = replace(seen, pixel=pixel, inverse_scale=np.full(len(seen), 0.2))
    fit = GaussNewtonFit(steps=8, width=20.0, point_reach=20.0)
    moved = np.clip(pose + random.normal(0, 2, body.n_dof) * body.sigma, body.lower, body.upper)
    found = refine(body, moved, None, CONFIG, (RIG, seen), fit=fit)[0]
    assert miss(body, found, pose) < 0.1 * miss(body, moved, pose)


@pytest.mark.parity("tracking/refinement.refine_system", "tracking/refinement.refine_end")
@pytest.mark.parametrize(
    ("name", "n_voxels", "n_points"),
    [
        *(
            pytest.param(
                "song31",
                *n,
                marks=pytest.mark.parity(
                    "tracking/refinement.refine_on", "tracking/refinement.refine_step"
                ),
            )
            for n in ((0, 0), (300, 70), (300, 0))
        ),
        ("stick", 0, 1),
        ("stick", 300, 0),
    ],
)
def test_twin_on_observed_points(device: Device, name: str, n_voxels: int, n_points: int) -> None:
    """Some of them behind a camera, wrong, or the other side's. The other kind of work-groups is
    left to one body: their kernels take 5 s to compile."""
    body, random = bodies.named(name), np.random.default_rng(n_points)
    kinds = [device] if name == "stick" else [device, other_kind(device)]
    config = CONFIG.with_changes(n_points=max(1, n_voxels))
    pose = bodies.random_poses(body, 1)[0]
    voxels = bodies.surface_points(body, pose, n_voxels)
    seen = make_empty_observations()
    if n_points:
        seen = seen_points(body, pose, RIG, n_points)
        other = seen_points(body, pose, RIG, n_points, as_partners=True)
        swapped = random.random(len(seen))[:, None] < 0.2
        pixel = np.where(swapped, other.pixel, seen.pixel + random.normal(0, 4, (len(seen), 2)))
        away = random.random(len(seen)) < 0.05
        seen = replace(seen, pixel=pixel + 300 * away[:, None])
    mean = np.clip(pose + random.normal(0, 1, body.n_dof) * body.sigma, body.lower, body.upper)
    expected = refine(body, mean, voxels, config, (RIG, seen), fit=USUAL)
    with skipped_without_room(device):
        for place in kinds:
            found = on_device(place, body, mean, voxels, config, USUAL, seen)
            assert_close(found, expected, 5e-4)


def test_nothing_to_refine_on(device: Device) -> None:
    mean = bodies.random_poses(SONG, 1)[0]
    found, _ = on_device(device, SONG, mean, np.empty((0, 3)), CONFIG)
    np.testing.assert_allclose(found, mean, atol=1e-6)
    off = CONFIG.with_changes(refinement_steps=0)
    assert Refinement(device, SONG, off).launcher(device.zeros((300, 4), np.float32), mean) == []
