"""The search for limbs: kernels against the twin, and use."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.parity import traced
from helpers.sightings import seen_points

from apf.body.kinematics import posed_cones, posed_joints
from apf.body.limbs import limb_masks
from apf.body.model import BodyModel
from apf.body.toml import load_body
from apf.filters import limb_search
from apf.filters.config import FilterConfig, GaussNewtonFit
from apf.filters.limb_search import LimbSearch
from apf.likelihood.base import Likelihood
from apf.likelihood.config import KeypointConfig
from apf.likelihood.keypoints import KeypointLikelihood
from apf.likelihood.observations import Observed
from apf.reference.filters.limb_search import propose, search_limbs
from apf.reference.filters.refinement import refine
from apf.reference.likelihood.keypoints import NumpyKeypointLikelihood
from apf.reference.likelihood.voxel import subset
from apf.scene import Scene
from cl import Array, Device
from psfs.common.cones import cone_distances

SONG = load_body("song31")
CONFIG = FilterConfig.create(
    n_particles=150, n_points=400, refinement_steps=5, limb_search_reach=12.0
)


def miss_wrist(pose: np.ndarray, true: np.ndarray) -> float:
    """The left wrist's distance, m, from that of the true pose."""
    wrists = posed_joints(SONG, np.stack([pose, true]))[:, SONG.joint_names.index("l_wrist")]
    return float(np.linalg.norm(wrists[1] - wrists[0]))


class Nearness(Likelihood):
    """Scores by the surface points alone, on the host: what a limb search needs of a likelihood,
    for the kernels (launches that copy) and for the twin."""

    def __init__(self, device: Device, body: BodyModel, points: np.ndarray) -> None:
        self.device, self.body = device, body
        self.host_points = points
        self.points = device.to_device(np.c_[points, np.ones(len(points))].astype(np.float32))
        self.errors = device.zeros((CONFIG.search.n_particles,), np.float32)

    def rescore(self, poses: np.ndarray, stride: int) -> np.ndarray:
        seen = subset(self.host_points, 0, stride)
        nearest = [np.abs(cone_distances(seen, c)).min(1) for c in posed_cones(self.body, poses)]
        return np.mean(np.square(nearest) / (np.square(nearest) + 0.05**2), axis=1)

    def rescoring_launcher(
        self, poses: Array, errors: Array, stride: int = 1, *unused: object
    ) -> list[Any]:
        return [lambda: errors.set(self.rescore(poses.get(), stride).astype(np.float32))]


def run_search(
    device: Device, body: BodyModel, likelihood: Any, mean: np.ndarray, config: FilterConfig
) -> tuple[np.ndarray, ...]:
    """Pose, shift, information, candidates and their errors by the kernels."""
    search = LimbSearch(device, body, likelihood, config)
    frame = device.to_device(np.array([7], np.uint32))
    result = device.to_device(mean.astype(np.float32))
    for launch in search.launcher(frame, result):
        launch()
    kept = search.candidates.get(), search.errors.get()
    return result.get(), search.shift.get(), search.information.get(), *kept


def test_proposals_move_one_limb_within_limits() -> None:
    mean = bodies.random_poses(SONG, 1)[0]
    poses, which = propose(SONG, mean, CONFIG, 3)
    np.testing.assert_array_equal(poses[0], mean)
    assert np.all((poses >= SONG.lower) & (poses <= SONG.upper))
    limbs = limb_masks(SONG)
    for pose, limb in zip(poses[1:], which[1:], strict=True):
        assert np.all((pose != mean) <= limbs[limb % len(limbs)])
    near = np.abs(poses - mean)[(which >= 0) & (which < len(limbs))].max(1)
    assert near[-20:].mean() > 3 * near[:20].mean()
    lower, upper = SONG.lower[limbs[0]], SONG.upper[limbs[0]]
    share = (poses[which == len(limbs)][:, limbs[0]] - lower) / (upper - lower)
    assert share.min() < 0.1 and share.max() > 0.9 and abs(share.mean() - 0.5) < 0.1


@pytest.mark.parity(
    "tracking/limb_search.propose", "tracking/limb_search.choose", "tracking/limb_search.accept"
)
@pytest.mark.parametrize(("n_particles", "n_points"), [(3, 5), (37, 400), (150, 400)])
def test_kernels_and_twin_on_voxels(device: Device, n_particles: int, n_points: int) -> None:
    size = {"n_particles": n_particles, "n_points": n_points, "refinement_steps": 1}
    config = CONFIG.with_changes(first_survival=0.9, last_survival=0.6, **size)
    pose = bodies.random_poses(SONG, 1)[0].astype(np.float32)
    kernels = Nearness(device, SONG, bodies.surface_points(SONG, pose, n_points))
    kernels.errors = device.zeros((n_particles,), np.float32)
    mean = np.clip(pose + 2 * SONG.sigma, SONG.lower, SONG.upper).astype(np.float32)
    found, shift, information, candidates, errors = run_search(device, SONG, kernels, mean, config)
    twin: Any = SimpleNamespace(points=kernels.host_points, observed=None)
    twin.rescore = lambda poses, stride, *_: kernels.rescore(poses, stride)
    expected = search_limbs(SONG, twin, mean.astype(float), config, 7)
    np.testing.assert_allclose(found, expected.pose, atol=1e-4)
    np.testing.assert_allclose(shift, found - mean, atol=1e-6)
    lower = expected.information[np.tril_indices(SONG.n_dof)]
    np.testing.assert_allclose(information, lower, atol=1e-3 * np.abs(lower).max())
    np.testing.assert_allclose(candidates.reshape(-1, SONG.n_dof), expected.candidates, atol=1e-4)
    np.testing.assert_allclose(errors, expected.errors, atol=1e-4)


def test_a_lost_arm_is_found(device: Device) -> None:
    """Within a few frames; refinement alone leaves it where it is."""
    pose = bodies.bent(SONG, l_upper_arm__rx=0.9)
    points = bodies.surface_points(SONG, pose, CONFIG.likelihood.n_points)
    likelihood = Nearness(device, SONG, points)

    def miss(config: FilterConfig) -> float:
        found = SONG.rest_pose
        for frame in range(8):
            found = run_search(device, SONG, likelihood, found, config.with_changes(seed=frame))[0]
        return miss_wrist(found, pose)

    assert miss(CONFIG) < 0.08
    assert miss(CONFIG.with_changes(limb_search_reach=0.0)) > 0.3


def test_an_arm_is_where_its_points_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """From a mean whose arm hangs: with them among the poses that are tried, else not."""
    rig, pose = scenes.ring(4, size=(640, 480)), bodies.bent(SONG, l_upper_arm__rx=2.2)
    scene = Scene(None, rig, None, SONG)  # type: ignore[arg-type]
    likelihood = NumpyKeypointLikelihood(scene, KeypointConfig(weight=4.0), 0.02)
    seen = seen_points(SONG, pose, rig, 60)
    likelihood.observe(Observed(None, replace(seen, partner=np.full(len(seen), -1))))
    config = CONFIG.with_changes(limb_search_reach=1.0)  # which does not reach it otherwise
    monkeypatch.setattr(limb_search, "MARGINS", (0.01, 1.0))
    search = (SONG, likelihood, SONG.rest_pose, config, 3)
    assert miss_wrist(search_limbs(*search).pose, pose) < 0.03
    held = property(lambda config: GaussNewtonFit(steps=6, width=1e-3, point_reach=60.0))
    monkeypatch.setattr(FilterConfig, "point_fit", held)
    assert miss_wrist(search_limbs(*search).pose, pose) > 0.2


@pytest.mark.parity("tracking/limb_search.propose", "tracking/refinement.refine_system")
def test_twin_on_observed_points(device: Device) -> None:
    body, rig = load_body("song31"), scenes.ring(3, size=(640, 480))
    config = CONFIG.with_changes(refinement_steps=2)
    pose = bodies.random_poses(body, 1)[0]
    scene = Scene(device, rig, None, body)
    term = KeypointConfig(weight=4.0)
    kernels = KeypointLikelihood(scene, term, 0.02, config.search.n_particles)
    twin = NumpyKeypointLikelihood(scene, term, 0.02)
    for likelihood in (kernels, twin):
        likelihood.observe(Observed(None, seen_points(body, pose, rig, 40)))
    mean = np.clip(pose + 2 * body.sigma, body.lower, body.upper)
    with traced("tracking/limb_search.propose") as proposing:
        found, shift, *_ = run_search(device, body, kernels, mean, config)
    expected = search_limbs(body, twin, mean, config, 7).pose
    np.testing.assert_allclose(found, expected, atol=1e-3)
    np.testing.assert_allclose(shift, found - mean, atol=1e-5)
    moved = (
        refine(body, mean, None, config, twin.observed, judge_last=False, fit=config.point_fit)[0]
        - mean
    )
    np.testing.assert_allclose(proposing[0].before["seen"][0], moved, atol=1e-3)
    poses, _ = propose(body, mean, config, 7, moved)
    np.testing.assert_allclose(proposing[0].after["poses"], poses, atol=1e-3)
