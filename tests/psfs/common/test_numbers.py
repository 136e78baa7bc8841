"""Tests of series of numbers."""

import numpy as np
import pytest
from scipy.signal import savgol_filter

from psfs.common.numbers import smooth_locally


@pytest.mark.parametrize(("window", "degree"), [(5, 2), (9, 3), (1, 0)])
def test_local_polynomials_are_those_of_scipy(window: int, degree: int) -> None:
    values = np.random.default_rng(0).normal(size=(20, 3, 2))
    expected = savgol_filter(values, window, degree, axis=0)
    np.testing.assert_allclose(smooth_locally(values, window, degree), expected, atol=1e-12)
