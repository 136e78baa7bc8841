"""Particle swarm and SIR filter: against their twins, and whether they find what there is."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers import scenes

from apf.body.model import BodyModel
from apf.body.toml import load_body
from apf.filters.config import FilterConfig
from apf.filters.searches import SirConfig, SwarmConfig
from apf.filters.sir import SirParticleFilter
from apf.filters.swarm import ParticleSwarm
from apf.likelihood.base import Likelihood
from apf.reference.filters.annealed import NumpySirParticleFilter
from apf.reference.filters.swarm import NumpyParticleSwarm
from apf.reference.likelihood.base import NumpyLikelihood
from apf.scene import Scene
from cl import Array, Device, NumpyDevice


class Distance(Likelihood, NumpyLikelihood):
    """Errors that are the distance of poses from the observed one, in sigmas; on the host, between
    a device's commands, or called as a twin."""

    def __init__(self, device: Device | None, body: BodyModel, n_particles: int) -> None:
        self.scale = np.maximum(body.sigma, 1e-9) * np.sqrt(body.n_dof)
        self.target = body.rest_pose
        self.calls = 0
        if device is not None:
            self.errors: Any = device.empty((n_particles,), np.float32)

    def observe(self, observation: np.ndarray) -> None:
        self.target = observation

    def __call__(self, poses: np.ndarray) -> np.ndarray:
        self.calls += 1
        return np.linalg.norm((poses - self.target) / self.scale, axis=1) / 10

    def launcher(self, poses: Array) -> list[Callable[[], None]]:
        return [lambda: self.errors.set(self(poses.get()).astype(np.float32))]


SONG = load_body("song31")
#: Survival rates that even two particles can reach.
MILD = {"first_survival": 0.9, "last_survival": 0.6}
FIELDS = ("pose", "deviation", "ess", "beta", "least_error")
SEARCHES = {
    "pso": (ParticleSwarm, NumpyParticleSwarm, {"n_layers": 5}),
    "sir": (SirParticleFilter, NumpySirParticleFilter, {"n_layers": 1}),
}


def moving(frames: int, step: float = 0.5) -> list[np.ndarray]:
    """Poses that wander from rest by about `step` sigmas per frame, within the limits."""
    random = np.random.default_rng(3)
    steps = random.normal(0, step, (frames, SONG.n_dof)) * SONG.sigma
    return list(np.clip(SONG.rest_pose + steps.cumsum(0), SONG.lower, SONG.upper))


def scene_on(device: Device | NumpyDevice) -> Scene:
    """A scene without voxels."""
    return Scene(device, scenes.ring(1), None, SONG)


def run(search: str, device: Device | None, config: FilterConfig, frames: int, *more: object):
    kind, twin, _ = SEARCHES[search]
    likelihood = Distance(device, SONG, config.search.n_particles)
    chosen = NumpyDevice() if device is None else device
    tracker = (twin if device is None else kind)(scene_on(chosen), likelihood, config, *more)
    tracker.start(SONG.rest_pose)
    return [tracker.step(target) for target in moving(frames)], likelihood


def config_of(search: str, n: int = 65, **settings: object) -> FilterConfig:
    return FilterConfig.create(n_particles=n, noise=1.0, **{**SEARCHES[search][2], **settings})


@pytest.mark.parametrize("search", [
    pytest.param("pso", marks=pytest.mark.parity(
        "tracking/swarm.move", "tracking/swarm.update_bests")),
    pytest.param("sir", marks=pytest.mark.parity("tracking/sir.squared_errors")),
])  # fmt: skip
@pytest.mark.parametrize(
    "settings",
    [{}, {"velocity": 0.6}, {"n_particles": 2, **MILD}, {"n_particles": 300}, {"noise": 8.0}],
)
def test_frames_agree_with_the_twin(device: Device, search: str, settings: dict) -> None:
    """With much noise particles reach their limits."""
    config = config_of(search).with_changes(**settings)
    for found, expected in zip(
        *(run(search, d, config, 3)[0] for d in (device, None)), strict=True
    ):
        # A choice that rounding decides is rare; it would move the estimate by a share of sigma.
        assert np.all(np.abs(found.pose - expected.pose) <= 0.02 * SONG.sigma)
        for field in FIELDS[1:]:
            np.testing.assert_allclose(
                getattr(found, field), getattr(expected, field), rtol=0.02, atol=1e-4
            )


def test_the_swarm_improves_and_follows(device: Device) -> None:
    config = config_of("pso", 200, n_layers=20)
    found, _ = run("pso", device, config, 4)
    for estimate, target in zip(found, moving(4), strict=True):
        assert np.all(np.diff(estimate.least_error) <= 0)
        assert estimate.ess[0] == 200 > estimate.ess[-1] > 0
        away = np.abs(estimate.pose - target) / SONG.sigma
        assert away.mean() < 0.35  # the frame before lies 0.5 sigma away
        error = np.linalg.norm((estimate.pose - target) / SONG.sigma / np.sqrt(31)) / 10
        assert estimate.least_error[-1] == pytest.approx(error, rel=1e-3)


@pytest.mark.parametrize("search", SEARCHES)
def test_limits_hold(device: Device, search: str) -> None:
    """A pose beyond the limits draws the particles to them, and not beyond."""
    config = config_of(search, n_layers=8 if search == "pso" else 1)
    tracker = SEARCHES[search][0](scene_on(device), Distance(device, SONG, 65), config)
    tracker.start(SONG.rest_pose)
    knee, far = SONG.dof_names.index("l_calf.ry"), SONG.rest_pose.copy()
    far[knee] = -1.0
    for _ in range(5):
        pose = tracker.step(far).pose
        assert np.all((pose >= SONG.lower - 1e-6) & (pose <= SONG.upper + 1e-6))
    assert pose[knee] < 0.05


def test_factors_of_the_searches(device: Device) -> None:
    """Without attraction nothing moves after the scattering; its twin agrees for odd factors."""
    still = SwarmConfig(inertia=0.0, cognitive=0.0, social=0.0)
    estimate = run("pso", device, config_of("pso"), 1, still)[0][0]
    assert estimate.ess.tolist() == [65, 0, 0, 0, 0]
    odd = SwarmConfig(inertia=0.3, cognitive=0.5, social=2.5)
    found, expected = (run("pso", d, config_of("pso"), 1, odd)[0][0] for d in (device, None))
    np.testing.assert_allclose(found.pose, expected.pose, atol=0.02 * SONG.sigma.max())
    both = (run("sir", d, config_of("sir"), 2, SirConfig(sigma_z=0.2))[0] for d in (device, None))
    for a, b in zip(*both, strict=True):
        assert a.beta[0] == pytest.approx(25)
        assert a.ess[0] == pytest.approx(b.ess[0], rel=1e-3)
