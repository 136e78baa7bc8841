"""Gaps of points over time, and the low-pass filter."""

import numpy as np
import pytest

import apf
from apf.tracking.triangulated import fill_gaps, low_pass


def line(frames: int = 40, points: int = 3) -> np.ndarray:
    """Return points (F, K, 3) that move along lines at constant speed."""
    random = np.random.default_rng(2)
    start, step = random.normal(size=(2, 1, points, 3))
    return start + step * np.arange(frames)[:, None, None]


def test_gaps_are_closed_with_lines_and_held_at_the_ends() -> None:
    whole = line()
    holed = whole.copy()
    holed[3:6, 0] = holed[10:20, 1] = holed[:4, 2] = holed[37:, 2] = np.nan
    filled = fill_gaps(holed)
    np.testing.assert_allclose(filled[:, :2], whole[:, :2], atol=1e-12)
    np.testing.assert_array_equal(filled[:4, 2], np.tile(whole[4, 2], (4, 1)))
    np.testing.assert_array_equal(filled[37:, 2], np.tile(whole[36, 2], (3, 1)))
    short = fill_gaps(holed, 3)
    assert np.isfinite(short[:, 0]).all() and np.isnan(short[10:20, 1]).all()
    assert np.isnan(short[:4, 2]).all() and np.isfinite(short[37:, 2]).all()
    assert np.isnan(fill_gaps(holed, 0)).sum() == np.isnan(holed).sum()
    holed[:, 1] = np.nan  # never seen
    assert np.isnan(fill_gaps(holed)[:, 1]).all() and np.isnan(low_pass(holed, 60, 6)[:, 1]).all()


def test_low_pass_halves_the_cut_off_and_keeps_what_is_slow() -> None:
    time = np.arange(600) / 60
    for hertz, share in ((1.0, 1.0), (6.0, 0.5), (18.0, 0.0)):
        wave = np.sin(2 * np.pi * hertz * time)[:, None, None] * np.ones((1, 1, 3))
        middle = low_pass(wave, 60, 6)[100:-100]
        amplitude = np.sqrt(2) * middle.std()
        assert amplitude == pytest.approx(share, abs=0.02)
        if share == 1.0:  # no delay
            np.testing.assert_allclose(middle, wave[100:-100], atol=0.02)
    for cutoff in (0, -1, 30, 100):
        with pytest.raises(apf.InputError, match="expected between 0 and 30, half of the frame"):
            low_pass(line(), 60, cutoff)


def test_low_pass_goes_round_gaps() -> None:
    whole = line(80)
    holed = whole.copy()
    holed[30:34, 0] = holed[40:, 0] = np.nan
    found = low_pass(holed, 60, 6)
    np.testing.assert_allclose(found[:30, 0], whole[:30, 0], atol=1e-3)
    np.testing.assert_array_equal(found[34:40, 0], whole[34:40, 0])  # too short for the filter
    assert np.isnan(found[30:34, 0]).all() and np.isfinite(found[:, 1:]).all()
