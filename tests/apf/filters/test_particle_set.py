"""One layer's bookkeeping: twin against known answers, kernels against the twin."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from helpers import bodies

from apf.body.limbs import root_mask
from apf.body.model import BodyModel
from apf.filters.config import FilterConfig, SearchConfig
from apf.filters.particle_set import ParticleSet, layer_sigmas
from apf.reference.filters.annealing import (
    annealing_exponent,
    diffuse,
    effective_size,
    normalised_weights,
    systematic_parents,
)
from apf.reference.filters.noise import normals, uniform
from cl import Device, Launch

SONG, STICK = bodies.named("song31"), bodies.named("stick")
#: Survival rates that even two particles can reach.
MILD = {"first_survival": 0.9, "last_survival": 0.6}


def errors_of(kind: str, n: int) -> np.ndarray:
    """(n,) float32 errors of particles."""
    random = np.random.default_rng(n)
    spread = random.gamma(4.0, 2.0, n)
    return KINDS[kind](np.arange(n), spread).astype(np.float32)


#: Errors of particles of these numbers, of others that are spread.
KINDS: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "spread": lambda k, spread: spread,
    "large": lambda k, spread: 5000 + spread,
    "narrow": lambda k, spread: 3 + 1e-4 * spread,
    "equal": lambda k, spread: np.full(len(k), 2.5),
    "zero": lambda k, spread: np.zeros(len(k)),
    "one dominant": lambda k, spread: np.where(k == len(k) // 3, 0.01, 1e4),
    "half the best": lambda k, spread: np.where(k % 2 == 0, 1.0, 1.0 + spread),
    "one hopeless": lambda k, spread: np.where(k == len(k) - 1, 1e30, spread),
}


@pytest.mark.parametrize("rate", [0.5, 0.2, 0.05])
@pytest.mark.parametrize("kind", ["spread", "large", "narrow"])
def test_beta_reaches_the_survival_rate(kind: str, rate: float) -> None:
    errors = errors_of(kind, 200).astype(float)
    beta = annealing_exponent(errors, rate)
    assert effective_size(errors, beta) == pytest.approx(rate * 200, rel=1e-3)
    weights = normalised_weights(errors, beta)
    assert 1 / np.sum(weights**2) == pytest.approx(rate * 200, rel=1e-3)
    assert weights.sum() == pytest.approx(1)
    assert np.argmax(weights) == np.argmin(errors)  # the sign of Song et al. eq. (16)


def test_weights_where_no_exponent_reaches_the_rate() -> None:
    equal = errors_of("equal", 10)
    np.testing.assert_allclose(normalised_weights(equal, annealing_exponent(equal, 0.3)), 0.1)
    half = errors_of("half the best", 10)
    weights = normalised_weights(half, annealing_exponent(half, 0.2))
    np.testing.assert_allclose(weights, [0.2, 0] * 5, atol=1e-9)
    one = errors_of("one dominant", 9)
    weights = normalised_weights(one, annealing_exponent(one, 1 - 1e-6))
    assert np.isfinite(weights).all() and weights.argmax() == 3


@pytest.mark.parametrize("offset", [1e-7, 0.3, 1 - 1e-7])
@pytest.mark.parametrize("n", [2, 37, 129])
def test_systematic_resampling_keeps_the_shares(n: int, offset: float) -> None:
    weights = np.random.default_rng(n).dirichlet(np.full(n, 0.3))
    parents = systematic_parents(weights, offset)
    assert len(parents) == n and np.all(np.diff(parents) >= 0)
    counts = np.bincount(parents, minlength=n)
    assert np.all(np.abs(counts - n * weights) < 1)


def test_children_are_reflected_at_the_limits() -> None:
    lower, upper = np.array([-1.0, -np.inf, 0.0]), np.array([1.0, np.inf, 0.5])
    poses = np.array([[0.9, 5.0, 0.1], [-0.9, -5.0, 0.4]])
    noise = np.array([[0.3, 100.0, -0.3], [-0.4, -100.0, 3.0]])
    children = diffuse(poses, np.array([0, 1]), noise, lower, upper)
    np.testing.assert_allclose(children, [[0.8, 105, 0.2], [-0.7, -105, 0.0]])
    swapped = diffuse(poses, np.array([1, 1]), 0 * noise, lower, upper)
    np.testing.assert_array_equal(swapped, poses[[1, 1]])


class Layer:
    """A `ParticleSet` of `n` particles whose frame, parents and weights the test sets."""

    def __init__(self, device: Device, body: BodyModel, n: int, **settings: float) -> None:
        settings = {"n_layers": 3, "trunk_layers": 0, "seed": 0x12345_6789ABCD, **MILD} | settings
        self.config = FilterConfig.create(n_particles=n, **settings).search
        self.set = ParticleSet(device, body, self.config)
        self.device = device
        self.set.start(body.rest_pose)

    def at_frame(self, frame: int) -> Layer:
        self.set.frame.set(np.array([frame], np.uint32))
        return self

    def anneal(self, layer: int, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Weights (N,), parents (N,) and (ess, beta, least error) of the layer."""
        self.set.anneal(layer, self.device.to_device(errors))()
        diagnostics = self.set.result.get()[2 * self.set.n_dof :].reshape(-1, 3)
        return self.set.weights.get(), self.set.parents.get(), diagnostics[layer]

    def diffuse(self, layer: int, poses: np.ndarray, parents: np.ndarray) -> np.ndarray:
        self.set.sets[0].set(poses.astype(np.float32))
        self.set.parents.set(parents.astype(np.int32))
        self.set.diffuse(layer, 0)()
        return self.set.sets[1].get()


@pytest.mark.parity("tracking/annealing.anneal")
@pytest.mark.parametrize("n", [2, 37, 1000])
@pytest.mark.parametrize("kind", KINDS)
def test_anneal_kernel_agrees_with_the_twin(device: Device, kind: str, n: int) -> None:
    errors = errors_of(kind, n)
    layer = Layer(device, STICK, n).at_frame(5)
    weights, parents, (ess, beta, least) = layer.anneal(1, errors)
    rate = layer.config.survival_rates[1]
    assert least == errors.min()
    assert beta > 0 and np.isfinite(beta)
    assert ess == pytest.approx(effective_size(errors.astype(float), float(beta)), rel=1e-3)
    expected = normalised_weights(errors.astype(float), float(beta))
    np.testing.assert_allclose(weights, expected, rtol=1e-3, atol=1e-6)
    assert weights.sum() == pytest.approx(1, abs=1e-5)
    if kind in ("spread", "large", "one hopeless") and n > 2:
        assert beta == pytest.approx(annealing_exponent(errors.astype(float), rate), rel=5e-3)
        assert ess == pytest.approx(rate * n, rel=1e-2)
    # Parents: the twin's but where rounding decides; each as often as its weight says.
    wanted = systematic_parents(weights.astype(float), uniform(layer.config.seed, 5, 1))
    assert np.abs(parents - wanted).max() <= 1 or kind == "half the best"
    assert (parents != wanted).mean() < 0.05
    counts = np.bincount(parents, minlength=n)
    assert len(counts) == n and np.all(np.abs(counts - n * weights) < 1 + 1e-3)
    assert np.all(np.diff(parents) >= 0)


@pytest.mark.parity("tracking/annealing.diffuse")
@pytest.mark.parametrize("n", [2, 37, 129])
@pytest.mark.parametrize("body", [SONG, STICK], ids=["song31", "stick"])
def test_diffuse_kernel_agrees_with_the_twin(device: Device, body: BodyModel, n: int) -> None:
    layer = Layer(device, body, n, noise=3.0).at_frame(11)
    poses = bodies.random_poses(body, n, wild=True).astype(np.float32)
    parents = np.random.default_rng(n).integers(0, n, n)
    children = layer.diffuse(2, poses, parents)
    noise = normals(layer.config.seed, 11, 2, n, body.n_dof)
    noise = noise * body.sigma * layer.config.layer_noise[2]
    expected = diffuse(poses.astype(float), parents, noise, body.lower, body.upper)
    np.testing.assert_allclose(children, expected, atol=5e-6)


@pytest.mark.parity("tracking/annealing.estimate")
@pytest.mark.parametrize("n", [2, 37, 129, 1000])
def test_estimate_is_the_weighted_mean(device: Device, n: int) -> None:
    layer = Layer(device, SONG, n)
    poses = bodies.random_poses(SONG, n, wild=True).astype(np.float32)
    weights = np.random.default_rng(n).dirichlet(np.full(n, 0.3)).astype(np.float32)
    layer.set.sets[1].set(poses)
    layer.set.weights.set(weights)
    layer.set.estimate(1)()
    found = layer.set.result.get()
    mean = weights @ poses.astype(float)
    np.testing.assert_allclose(found[: SONG.n_dof], mean, atol=1e-5)
    deviation = np.sqrt(weights @ (poses - mean) ** 2)
    np.testing.assert_allclose(found[SONG.n_dof : 2 * SONG.n_dof], deviation, atol=1e-5)
    assert not found[2 * SONG.n_dof :].any()  # the layers' diagnostics are left alone


@pytest.mark.parity("tracking/annealing.end_frame")
@pytest.mark.parametrize("frame", [0, 1, 5])
def test_end_of_frame_reports_and_expects_the_change_again(device: Device, frame: int) -> None:
    n, velocity, random = 37, 0.4, np.random.default_rng(0)
    layer = Layer(device, SONG, n, velocity=velocity).at_frame(frame)
    particles = layer.set
    particles.sets[0].set(bodies.random_poses(SONG, n, wild=True).astype(np.float32))
    particles.weights.set(np.full(n, 1 / n, np.float32))
    particles.estimate(0)()
    mean = particles.result.get()[: SONG.n_dof]
    motion = particles.motion.get()
    motion[:, 2] = before = random.normal(size=mean.shape).astype(np.float32)
    particles.motion.set(motion)
    shift = random.normal(size=mean.shape).astype(np.float32)
    sizes = (496, 9 * SONG.n_dof, 9, 1)  # information, candidates, errors, misfit
    others = [random.random(size).astype(np.float32) for size in sizes]
    given = [device.to_device(array) for array in (shift, *others)]
    report = device.empty(particles.result.size + sum(sizes), np.float32)
    particles.end_frame(*given, report)()
    expected = np.concatenate([particles.result.get(), *others])
    np.testing.assert_array_equal(report.get(), expected)
    after = np.where(root_mask(SONG), (1 - velocity) * before, 0.0)
    after += velocity * mean if frame > 1 else 0.0
    np.testing.assert_allclose(particles.motion.get()[:, 1], shift + after, atol=1e-5)
    np.testing.assert_allclose(particles.motion.get()[:, 2], after, atol=1e-5)


@pytest.mark.parity("tracking/annealing.anneal_diffuse")
@pytest.mark.parametrize("n", [2, 37, 200, 1000])
def test_two_stages_in_one_launch_are_the_same(device: Device, n: int) -> None:
    layer = Layer(device, SONG, n, noise=3.0)
    particles, errors = layer.set, errors_of("spread", n)
    poses = bodies.random_poses(SONG, n).astype(np.float32)

    def found(*launches: Launch) -> list[np.ndarray]:
        layer.at_frame(5)
        particles.sets[0].set(poses)
        outputs = [particles.weights, particles.parents, particles.result, particles.sets[1]]
        for array in outputs:
            array.fill(0)
        for launch in launches:
            launch()
        return [array.get() for array in outputs]

    on_device = device.to_device(errors)
    apart = found(particles.anneal(1, on_device), particles.diffuse(2, 0))
    both = particles.anneal_diffuse(1, on_device, 0)
    for one, other in zip(found(both), apart, strict=True):
        np.testing.assert_array_equal(one, other)
    particles.widen(0.0)
    np.testing.assert_allclose(found(both)[3], poses[apart[1]], atol=1e-6)


def test_the_trunk_goes_first() -> None:
    config = SearchConfig(trunk_layers=3, noise_decay=0.8)
    noise = layer_sigmas(SONG, config) * config.layer_noise[:, None]
    limb, trunk = SONG.dof_names.index("l_thigh.ry"), SONG.dof_names.index("pelvis.tx")
    assert np.all(noise[:3, limb] == 0) and np.all(noise[:3, trunk] > 0)
    plain = config.noise * SONG.sigma * 0.8 ** np.arange(10)[:, None]
    np.testing.assert_allclose(noise[3:, limb], plain[:7, limb])
    np.testing.assert_allclose(noise[:, trunk], plain[:, trunk])
