"""What the diagnostics take out of small pictures."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from helpers import scenes

from cl import Device
from psfs.backend import make_evidence_function, make_evidence_pipeline
from psfs.diagnostics.small_views import extract_outline
from psfs.diagnostics.tangency import CAP, Tangency
from psfs.sequence import Frame
from psfs.silhouettes.config import SilhouetteConfig


@pytest.mark.parametrize("speck", [(0, 0), (110, 70)])
def test_an_outline_is_the_hull_of_the_largest_part(speck: tuple[int, int]) -> None:
    mask = np.zeros((120, 90), bool)
    body = cv2.ellipse(np.zeros(mask.shape, np.uint8), (60, 50), (18, 40), 20, 0, 360, 1, -1) > 0
    body &= ~np.roll(body, 12, axis=1)  # a crescent: its hull is more than it
    mask |= body
    row, column = speck
    mask[row : row + 7, column : column + 7] = True
    found = extract_outline(mask)
    assert found is not None
    part = cv2.medianBlur(body.astype(np.uint8), 3) > 0
    pixels = np.argwhere(part)[:, ::-1].astype(np.int32)
    expected = cv2.convexHull(pixels).reshape(-1, 2)
    assert {*map(tuple, found.points.tolist())} == {*map(tuple, expected.tolist())}
    assert found.area == part.sum()
    assert not found.at_border.any()


def test_an_outline_on_the_border_says_so() -> None:
    mask = np.zeros((40, 50), bool)
    mask[10:30, :20] = True
    found = extract_outline(mask)
    assert found is not None
    np.testing.assert_array_equal(found.at_border, found.points[:, 0] == 0)
    assert found.at_border.any()


def test_nobody_has_no_outline() -> None:
    mask = np.zeros((40, 50), bool)
    assert extract_outline(mask) is None
    mask[3:8, 3:8] = True  # fewer pixels than count
    assert extract_outline(mask) is None


def test_lags_of_planes_at_once() -> None:
    random = np.random.default_rng(4)
    a, b = random.normal(0, 0.1, (2, 30, 2))
    a[3:9, 0] = b[20:, 1] = np.nan
    rig = scenes.ring(3, (64, 48))
    tangency = Tangency(rig, [[None] * 3] * 30)
    tangency.size = 1.7
    at_once = tangency.differences(a, b, 40, steady=True, cap=CAP)
    one_by_one = [tangency.difference(a, b, lag) for lag in range(-40, 41)]
    np.testing.assert_allclose(at_once, one_by_one, atol=1e-12)
    # What is the same in all frames is no lag.
    aside = tangency.differences(a + np.array([0.3, -0.2]), b, 5, steady=False, cap=1.0)
    expected = tangency.differences(a, b, 5, steady=False, cap=1.0)
    np.testing.assert_allclose(aside, expected, atol=1e-12)
    apart = (a[2:] - b[:-2]) / 1.7
    rest = np.abs(apart - np.nanmedian(apart, axis=0))
    np.testing.assert_allclose(expected[3], [np.nansum(rest), np.isfinite(rest).sum()], atol=1e-12)


def test_evidence_of_one_frame_ahead(device: Device) -> None:
    rig, random = scenes.ring(2, (64, 48)), np.random.default_rng(8)
    frames = [
        Frame(k, None, random.integers(0, 256, (2, 48, 64)).astype(np.uint8)) for k in range(4)
    ]
    now = make_evidence_function(device, rig, None, SilhouetteConfig())
    begin = make_evidence_pipeline(device, rig, None, SilhouetteConfig())
    before = begin(frames[0])
    for number, frame in enumerate(frames[1:]):
        begun = begin(frame)
        np.testing.assert_array_equal(before(), now(frames[number]))
        before = begun
