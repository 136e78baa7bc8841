"""The tracker's settings: schedules, and what is refused."""

import numpy as np
import pytest

from apf.filters.config import FilterConfig, SearchConfig
from apf.filters.term_weights import parse_weights


def test_single_settings_find_their_parts_and_schedules() -> None:
    config = FilterConfig.create(
        n_layers=3, surface_weight=0.1, part_colour_weight=0.5, refinement_steps=1
    )
    assert config.search.n_layers == 3 and config.likelihood.surface_weight == 0.1
    assert config.likelihood.part_colour.weight == 0.5 and config.refinement.steps == 1
    other = config.with_changes(limb_search_reach=2.0)
    assert other.limb_search.reach == 2 and other.search == config.search
    assert FilterConfig.create(**other.settings) == other
    every = "edge,silhouette,surface,overlap,posture,part_colour,contour,pictures"
    named = FilterConfig.create(**parse_weights(every))
    assert named == FilterConfig.create(limb_search_least_recall=0.0)
    assert parse_weights("surface=2.5")["surface_weight"] == 2.5
    with pytest.raises(TypeError, match="no setting of a filter: two_sided"):
        FilterConfig.create(two_sided=1.0)
    rates = {"first_survival": 0.6, "last_survival": 0.2}
    search = SearchConfig(n_layers=5, noise=2.0, noise_decay=0.5, **rates)
    np.testing.assert_allclose(search.survival_rates, [0.6, 0.5, 0.4, 0.3, 0.2])
    np.testing.assert_allclose(search.layer_noise, [2, 1, 0.5, 0.25, 0.125])
