"""Offsets of cameras from signals and measurements."""

from itertools import combinations

import numpy as np
import pytest

from psfs.footage.camera_times import (
    MeasuredOffset,
    combine_offsets,
    compare_signals,
    estimate_times,
)

FRAMES, MOST = 200, 30


def signals(offsets: list[float], noise: float, seed: int = 0) -> list[np.ndarray]:
    """A smooth random signal (F, 1) as cameras of these offsets show it, each with a constant and
    noise of its own."""
    random = np.random.default_rng(seed)
    knots = random.normal(size=FRAMES)
    times = np.arange(FRAMES, dtype=float)
    shown = [np.interp(times - by, 6 * np.arange(FRAMES) - 300, knots) for by in offsets]
    return [(s + random.normal(size=FRAMES) * noise + k)[:, None] for k, s in enumerate(shown)]


def estimate(shown: list[np.ndarray]):
    pairs = combinations(range(len(shown)), 2)
    costs = {(a, b): compare_signals(shown[a], shown[b], 2 * MOST, 10.0) for a, b in pairs}
    return estimate_times(len(shown), costs)


@pytest.mark.parametrize("offsets", [[0, 0, 7, 0], [0, -12, 0, 3.4, 0.3]])
def test_offsets_by_signals_with_their_deviations(offsets: list[float]) -> None:
    found = estimate(signals(offsets, 0.1))
    expected = np.array(offsets) - np.median(offsets)
    assert (np.abs(found.offsets - expected) < np.maximum(4 * found.sigmas, 0.15)).all()
    assert (found.sigmas < 0.5).all()
    assert ((found.chances < 1e-3) == (np.abs(expected) > 1)).all()


def test_signals_that_have_nothing_in_common_tell_no_offset() -> None:
    for seed in range(10):
        shown = [signals([0], 0.1, 10 * seed + k)[0] for k in range(4)]
        assert estimate(shown).chances.min() > 1e-3


def test_measured_offsets_are_weighted_by_their_deviations() -> None:
    rows = [MeasuredOffset(0, 1, 2.0, 0.1), MeasuredOffset(1, 2, 1.0, 0.1)]
    offsets, sigmas = combine_offsets(3, [*rows, MeasuredOffset(0, 2, 9.0, 100.0)])
    np.testing.assert_allclose(offsets, [-2, 0, 1], atol=1e-3)
    assert sigmas.max() < 0.2
