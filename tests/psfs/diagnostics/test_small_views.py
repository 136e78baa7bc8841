"""What the diagnostics take out of small pictures, and what each camera sees of the person."""

import cv2
import numpy as np
import pytest
from helpers import scenes

from cl import Device
from psfs.backend import make_evidence_function, make_evidence_pipeline
from psfs.diagnostics.person_in_view import find_person_in_views
from psfs.diagnostics.small_views import SmallViews, extract_outline
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


def test_outlines_on_the_border_and_of_nobody() -> None:
    mask = np.zeros((40, 50), bool)
    assert extract_outline(mask) is None
    mask[3:8, 3:8] = True  # fewer pixels than count
    assert extract_outline(mask) is None
    mask[10:30, :20] = True
    found = extract_outline(mask)
    assert found is not None and found.at_border.any()
    np.testing.assert_array_equal(found.at_border, found.points[:, 0] == 0)


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


def draw_person(x: int, y: int, there: bool = True) -> np.ndarray:
    mask = np.zeros((120, 160), bool)
    if there:
        mask[max(0, y) : y + 60, max(0, x) : x + 20] = True
    return mask


def make_views() -> SmallViews:
    """Ten frames of three cameras: one sees all, one half of it, one the person without feet."""
    frames = [
        [draw_person(40 + 2 * k, 30), draw_person(60, 30, k < 5), draw_person(60, 90)]
        for k in range(10)
    ]
    outlines = [[extract_outline(mask) for mask in row] for row in frames]
    share = np.ones((10, 3))
    empty = np.zeros((0, 3, 120, 160))
    return SmallViews(
        scenes.ring(3, (160, 120)), range(10), outlines, share, share, share, None,
        np.zeros(0, int), empty > 0, None,
    )  # fmt: skip


def test_cameras_that_see_too_little_are_told_what_to_do() -> None:
    views = make_views()
    whole, half, cut = find_person_in_views(views.rig, views.outlines, 2.0)
    assert (whole.seen, whole.whole, whole.height) == (1, 1, 120) and not whole.describe()
    assert half.seen == 0.5 and "in 50% of the frames: turn it" in half.describe()
    assert cut.whole == 0 and "beyond the picture's bottom" in cut.describe()
    small = find_person_in_views(views.rig, views.outlines, 1.0)[0]
    assert "a person of 60 px" in small.describe()
