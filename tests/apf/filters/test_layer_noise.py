"""Deviations of the layers' particles."""

from __future__ import annotations

import numpy as np
import pytest

from apf.body.toml import load_body
from apf.filters.config import SearchConfig
from apf.filters.layer_noise import layer_sigmas
from cl import InputError

SONG = load_body("song31")


def test_without_trunk_layers_all_spread_alike() -> None:
    sigmas = layer_sigmas(SONG, SearchConfig(trunk_layers=0))
    assert sigmas.shape == (10, 31)
    np.testing.assert_array_equal(sigmas, np.broadcast_to(SONG.sigma, sigmas.shape))


def test_the_trunk_goes_first() -> None:
    config = SearchConfig(trunk_layers=3, noise_decay=0.8)
    noise = layer_sigmas(SONG, config) * config.layer_noise[:, None]
    limb, trunk = SONG.dof_names.index("l_thigh.ry"), SONG.dof_names.index("pelvis.tx")
    assert np.all(noise[:3, limb] == 0) and np.all(noise[:3, trunk] > 0)
    plain = config.noise * SONG.sigma * 0.8 ** np.arange(10)[:, None]
    np.testing.assert_allclose(noise[3:, limb], plain[:7, limb])
    np.testing.assert_allclose(noise[:, trunk], plain[:, trunk])


def test_settings_are_checked() -> None:
    with pytest.raises(InputError, match="expected"):
        SearchConfig(trunk_layers=-1)
