"""The floor below the lowest places of a person."""

import numpy as np

from psfs.self_calibration.world import fit_floor


def test_hands_that_are_lowest_do_not_tilt_the_floor():
    rng = np.random.default_rng(3)
    low = np.column_stack([rng.uniform(-1.6, 1.6, (160, 2)), rng.normal(0, 0.015, 160)])
    low[:, 2] += 0.03 * low[:, 0] - 0.02 * low[:, 1]
    low[low[:, 0] > 1.2, 2] += 0.9  # at one end of the walk the feet are not seen
    assert 10 < (low[:, 2] > 0.5).sum() < 40
    np.testing.assert_allclose(fit_floor(low), [0.03, -0.02], atol=0.004)
