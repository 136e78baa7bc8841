"""The keypoints' term of the likelihood, and its kernel against the twin."""

from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.kinds import other_kind
from helpers.likelihoods import Setup, only
from helpers.sightings import seen_points

from apf.body.toml import load_body
from apf.likelihood.base import Likelihood
from apf.likelihood.config import EXCHANGE_COST, KeypointConfig
from apf.likelihood.keypoints import KeypointLikelihood
from apf.likelihood.observations import Observed, PointObservations, make_empty_observations
from apf.reference.likelihood.keypoints import NumpyKeypointLikelihood, missed_shares
from apf.scene import Scene
from cl import Device

SONG = load_body("song31")
CONFIG, POSTURE = KeypointConfig(weight=3.0), 0.02


def test_the_pose_that_was_seen_misses_nothing() -> None:
    """The cost of an outlier is bounded, a missing one costs nothing, left taken for right the
    exchange."""
    rig, pose = scenes.ring(3), bodies.random_poses(SONG, 1)[0]
    seen = seen_points(SONG, pose, rig, 20)
    assert missed_shares(SONG, rig, pose[None], seen).max() < 1e-12
    away = missed_shares(SONG, rig, pose[None] + [0.5, *[0] * 30], seen)
    assert away.min() > 0.05
    wrong = replace(seen, pixel=seen.pixel + np.eye(len(seen))[:, :1] * 1e5)
    shares = missed_shares(SONG, rig, pose[None], wrong)[0]
    assert 0.99 < shares[0] <= 1 and shares[1:].max() < 1e-12
    likelihood = NumpyKeypointLikelihood(Scene(None, rig, None, SONG), CONFIG, POSTURE)  # type: ignore[arg-type]

    def error(observations: PointObservations) -> float:
        likelihood.observe(Observed(None, observations))
        return float(likelihood(pose[None])[0])

    fewer = replace(seen, **{
        name: getattr(seen, name)[5:]
        for name in ("point", "partner", "camera", "pixel", "inverse_scale")
    })  # fmt: skip
    assert error(fewer) == pytest.approx(error(seen))
    assert error(wrong) - error(seen) == pytest.approx(3 * CONFIG.weight / len(seen))
    swapped = seen_points(SONG, pose, rig, 20, as_partners=True)
    swapped = replace(swapped, inverse_scale=10 * swapped.inverse_scale)
    shares = missed_shares(SONG, rig, pose[None], swapped)[0]
    paired = swapped.partner >= 0
    assert paired.any() and shares[paired].max() <= EXCHANGE_COST + 1e-9
    lonely = replace(swapped, partner=np.full(len(swapped), -1))
    assert missed_shares(SONG, rig, pose[None], lonely)[0][paired].mean() > EXCHANGE_COST


@pytest.mark.parity("tracking/keypoints.score_points")
@pytest.mark.parametrize("kind", ["own", "other"])
@pytest.mark.parametrize("n", [0, 1, 37, 300])
def test_kernel_agrees_with_the_twin(device: Device, n: int, kind: str) -> None:
    """Alone: the term with the posture prior, and the misfit."""
    device = device if kind == "own" else other_kind(device)
    body, rig = SONG, scenes.ring(3)
    poses = bodies.random_poses(body, 23, wild=True).astype(np.float32)
    seen = replace(seen_points(body, poses[3].astype(float), rig, max(1, n // 3)), most=350.0)
    if n == 0:
        seen = make_empty_observations()
    scene = Scene(device, rig, None, body)
    kernel = KeypointLikelihood(scene, CONFIG, POSTURE, 23)
    twin = NumpyKeypointLikelihood(scene, CONFIG, POSTURE)
    for likelihood in (kernel, twin):
        likelihood.observe(Observed(None, seen))
    on_device = device.to_device(poses)
    for launch in [*kernel.launcher(on_device), *kernel.misfit_launcher(on_device)]:
        launch()
    expected = twin(poses.astype(float))
    np.testing.assert_allclose(kernel.errors.get(), expected, rtol=2e-4, atol=1e-4)
    misfit = twin.misfit(poses[0].astype(float))
    np.testing.assert_allclose(kernel.misfits.get()[0], misfit, rtol=2e-4, atol=1e-5)


@pytest.mark.parity("tracking/keypoints.score_points")
def test_it_adds_to_another_likelihood(device: Device) -> None:
    """To its errors, in its unit, and takes its points and misfits."""
    body, rig = SONG, scenes.ring(3)
    poses = bodies.random_poses(body, 23).astype(np.float32)
    seen, scene = seen_points(body, poses[3].astype(float), rig, 9), Scene(device, rig, None, body)
    base: Any = Likelihood()
    base.errors = device.to_device(np.full(23, 7, np.float32))
    base.unit, base.observe, base.launcher = 2.0, Mock(), lambda poses: []
    term = KeypointLikelihood(scene, CONFIG, POSTURE, 23, base)
    term.observe(Observed("shown", seen))
    base.observe.assert_called_once_with("shown")
    for launch in term.launcher(device.to_device(poses)):
        launch()
    shares = missed_shares(body, rig, poses.astype(float), seen)
    expected = 7 + 2 * CONFIG.weight * shares.mean(1)
    np.testing.assert_allclose(term.errors.get(), expected, rtol=2e-4)
    assert term.points is base.points and term.observed is None


@pytest.mark.parity("tracking/likelihood.score_poses")
@pytest.mark.parametrize("n", [0, 37, 300])
@pytest.mark.parametrize("kind", ["own", "other"])
def test_the_voxels_kernel_takes_the_term(device: Device, n: int, kind: str) -> None:
    """The voxels' errors grow by what the twin says of the points; misfits do not."""
    device, rig = device if kind == "own" else other_kind(device), scenes.ring(3)
    setup = Setup(device, SONG, rig, bodies.random_poses(SONG, 23), only("edge"))
    seen = seen_points(SONG, setup.poses[3].astype(float), rig, max(1, n // 3))
    seen = replace(seen, most=350.0) if n else make_empty_observations()
    alone, voxels = setup.errors(), setup.likelihood
    scene = Scene(device, rig, scenes.small_grid(0.1), SONG)
    term = KeypointLikelihood(scene, CONFIG, POSTURE, 23, voxels)
    term.observed.set(seen)
    misfits = device.zeros((23,), np.float32)
    errors = device.zeros((23,), np.float32)
    for launch in [
        *term.launcher(setup.on_device),
        *term.rescoring_launcher(setup.on_device, errors, misfits=misfits),
        *term.misfit_launcher(setup.on_device),
    ]:
        launch()
    shares = missed_shares(SONG, rig, setup.poses.astype(float), seen).sum(1)
    expected = alone + len(rig) * CONFIG.weight * shares / 350.0
    np.testing.assert_allclose(term.errors.get(), expected, rtol=2e-4, atol=1e-4)
    np.testing.assert_allclose(errors.get(), expected, rtol=2e-4, atol=1e-4)
    assert misfits.get()[0] == pytest.approx(voxels.misfits.get()[0], rel=1e-5)
    assert len(np.unique(misfits.get())) > 10
