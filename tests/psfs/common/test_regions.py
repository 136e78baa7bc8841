"""Regions of pixels and voxels, and series of numbers."""

import numpy as np
import pytest
from scipy import ndimage
from scipy.signal import savgol_filter

from psfs.common.numbers import smooth_locally
from psfs.common.regions import (
    bounding_box,
    fill_holes,
    find_largest_region_box,
    iou,
    keep_large_regions,
    split_regions,
)


def test_iou() -> None:
    a, b = np.array([True, True, False]), np.array([True, False, False])
    assert iou(a, b) == 0.5 and iou(a, a) == 1.0 and iou(a, ~a) == 0.0
    assert np.isnan(iou(~a & a, b & ~b))


@pytest.mark.parametrize("dimensions", [2, 3])
def test_small_parts_go(dimensions: int) -> None:
    occupied = np.zeros((20,) * dimensions, bool)
    large, small = (slice(1, 9),) * dimensions, (slice(12, 14),) * dimensions
    occupied[large] = occupied[small] = True
    occupied[(9,) * dimensions] = True  # connected by a corner
    only = occupied.copy()
    only[small] = False
    np.testing.assert_array_equal(keep_large_regions(occupied, 0.1), only)
    np.testing.assert_array_equal(keep_large_regions(occupied, 0.0), occupied)
    box = find_largest_region_box(np.flatnonzero(occupied), occupied.shape)
    assert box is not None
    np.testing.assert_array_equal(box, [[1] * dimensions, [10] * dimensions])


@pytest.mark.parametrize("shape", [(30, 40), (12, 13, 14), (1, 5)])
def test_holes_are_filled_as_scipy_fills_them(shape: tuple[int, ...]) -> None:
    for share in (0.0, 0.4, 0.7, 1.0):
        occupied = np.random.default_rng(0).random(shape) < share
        np.testing.assert_array_equal(fill_holes(occupied), ndimage.binary_fill_holes(occupied))


def test_nothing_has_no_parts() -> None:
    empty = np.zeros((4, 5), bool)
    assert not keep_large_regions(empty, 0.5).any() and bounding_box(empty) is None
    assert find_largest_region_box(np.flatnonzero(empty), empty.shape) is None
    assert keep_large_regions(empty[:0], 0.5).shape == (0, 5)


def test_bounding_box() -> None:
    region = np.zeros((7, 9), bool)
    region[2, 5] = region[4, 3] = True
    assert bounding_box(region) == (slice(2, 5), slice(3, 6))


@pytest.mark.parametrize("density", [0.01, 0.06, 0.3])
def test_parts_are_those_of_the_whole_grid(density: float) -> None:
    """Also of voxels at opposite borders, which are neighbours in memory only."""
    for shape in ((9, 5, 7), (1, 12, 3), (4, 4, 4)):
        flags = np.random.default_rng(1).random(shape) < density
        flags[0, 0, 0] = True
        labels, count = ndimage.label(flags, np.ones((3, 3, 3)))
        expected = {tuple(np.flatnonzero(labels == number)) for number in range(1, count + 1)}
        parts = split_regions(np.flatnonzero(flags), shape)
        assert {*map(tuple, parts)} == expected and len(parts) == count
        assert sorted(map(len, parts), reverse=True) == [*map(len, parts)]


@pytest.mark.parametrize("window", [3, 5, 9])
def test_local_parabolas_are_those_of_scipy(window: int) -> None:
    values = np.random.default_rng(0).normal(size=(20, 3, 2))
    expected = savgol_filter(values, window, 2, axis=0)
    np.testing.assert_allclose(smooth_locally(values, window), expected, atol=1e-12)
