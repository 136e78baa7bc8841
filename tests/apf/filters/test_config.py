"""The tracker's settings: schedules, and what is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from apf.filters.config import FilterConfig, likelihood_weights
from cl import InputError


def test_defaults_are_the_seed_setting() -> None:
    config = FilterConfig()
    assert (config.n_particles, config.n_layers) == (200, 10)


def test_schedules() -> None:
    config = FilterConfig(
        n_layers=5, first_survival=0.6, last_survival=0.2, noise=2.0, noise_decay=0.5
    )
    np.testing.assert_allclose(config.survival_rates, [0.6, 0.5, 0.4, 0.3, 0.2])
    np.testing.assert_allclose(config.layer_noise, [2, 1, 0.5, 0.25, 0.125])


def test_one_layer_takes_the_first_values() -> None:
    config = FilterConfig(n_layers=1, first_survival=0.3, noise=1.5)
    np.testing.assert_array_equal(config.survival_rates, [0.3])
    np.testing.assert_array_equal(config.layer_noise, [1.5])


def test_weights_are_in_the_order_of_the_kernel() -> None:
    config = FilterConfig(edge_weight=1, silhouette_weight=2, surface_weight=3, overlap_weight=4)
    np.testing.assert_array_equal(config.weights, np.array([1, 2, 3, 4], np.float32))
    assert config.weights.dtype == np.float32


def test_song_alone_may_be_chosen() -> None:
    config = FilterConfig(surface_weight=0, overlap_weight=0, spread=0)
    assert config.weights[2] == config.weights[3] == 0


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("n_particles", 1),
        ("n_particles", 0),
        ("n_layers", 0),
        ("n_points", 0),
        ("first_survival", 1.0),
        ("first_survival", 0.0),
        ("last_survival", 1 / 200),  # one particle alone would have to survive
        ("last_survival", float("nan")),
        ("noise", 0.0),
        ("noise", float("nan")),
        ("noise_decay", -0.5),
        ("surface_scale", 0.0),
        ("sample_spacing", 0.0),
        ("spread", -0.1),
        ("velocity", -1.0),
        ("edge_weight", -1.0),
        ("silhouette_weight", float("nan")),
        ("surface_weight", -1.0),
        ("overlap_weight", -1.0),
        ("seed", -1),
        ("seed", 2**64),
    ],
)
def test_impossible_settings_are_refused_with_their_value(setting: str, value: float) -> None:
    with pytest.raises(InputError) as caught:
        FilterConfig(**{setting: value})
    message = str(caught.value)
    assert "expected" in message and "\n" not in message
    assert f"{value:.3g}" in message or str(value) in message


def test_few_particles_need_a_milder_last_layer() -> None:
    with pytest.raises(InputError, match="last_survival"):
        FilterConfig(n_particles=10)
    assert FilterConfig(n_particles=10, last_survival=0.2).n_particles == 10
    assert FilterConfig(n_particles=2, first_survival=0.9, last_survival=0.6).n_particles == 2


def test_settings_cannot_be_changed_behind_the_launches() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        FilterConfig().n_layers = 3  # type: ignore[misc]
    assert FilterConfig(seed=2**64 - 1).seed == 2**64 - 1


def test_terms_of_the_likelihood_by_name() -> None:
    default = FilterConfig()
    song = FilterConfig(**likelihood_weights("edge,silhouette"))
    assert song.weights.tolist() == [default.edge_weight, default.silhouette_weight, 0, 0]
    assert song.posture_weight == 0
    assert FilterConfig(**likelihood_weights("surface=2.5")).weights.tolist() == [0, 0, 2.5, 0]
    every = FilterConfig(**likelihood_weights("edge,silhouette,surface,overlap,posture"))
    assert every == dataclasses.replace(default, limb_two_sided=0.0)


@pytest.mark.parametrize("wrong", ["", "edge,colours", "edge=much", "edge:2"])
def test_unknown_terms(wrong: str) -> None:
    with pytest.raises(InputError, match="likelihood"):
        likelihood_weights(wrong)
