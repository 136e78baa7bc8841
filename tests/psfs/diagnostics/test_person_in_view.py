"""What each camera sees of the person: frames, wholeness, height."""

import numpy as np
from helpers import scenes

from psfs.diagnostics.person_in_view import find_person_in_views
from psfs.diagnostics.small_views import SmallViews, extract_outline


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
