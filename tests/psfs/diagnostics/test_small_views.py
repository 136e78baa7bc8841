"""What the diagnostics take out of small pictures."""

import cv2
import numpy as np
import pytest
from helpers import scenes

from cl import Device
from psfs.backend import make_evidence_function, make_evidence_pipeline
from psfs.diagnostics.small_views import extract_outline
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
