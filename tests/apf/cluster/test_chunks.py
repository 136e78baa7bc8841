"""Cutting a long take into chunks, and joining the chunks where they agree."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from helpers.tracks import lose, walker

from apf.cli.batch_chunks import cut_chunks, find_seam, join_tracks
from apf.tracking.track import Track


def part_of(track: Track, begin: int, end: int, shift: np.ndarray | float = 0.0) -> Track:
    """Return frames begin to end of a track, moved by `shift` (F,) m."""
    part = track.select(np.arange(begin, end))
    return replace(part, joints=part.joints + np.reshape(shift * np.ones(len(part)), (-1, 1, 1)))


def test_parts_cover_all_and_overlap_and_short_takes_are_not_cut() -> None:
    """Nor is a take cut into chunks that would consist of overlap only."""
    parts = cut_chunks(range(10, 400, 3), 40, 8)
    assert len(parts) == 3
    assert parts[0][0] == 10 and parts[-1][-1] == 397
    for first, second in pairwise(parts):
        assert len(set(first) & set(second)) == 8
    assert set().union(*parts) == set(range(10, 400, 3))
    for n_frames in (90, 130, 1000, 5):
        assert cut_chunks(range(100), n_frames, 8) == [range(100)]


def test_parts_are_joined_where_they_agree_best_and_nobody_is_lost() -> None:
    track = walker(60)
    rising = np.abs(np.arange(20) - 6) * 0.01 + 0.003
    second = part_of(track, 30, 60, np.r_[rising, np.zeros(10)])
    whole, (found,) = join_tracks([part_of(track, 0, 50), second])
    assert found.frame == 36 and found.distance == pytest.approx(0.003 * np.sqrt(3), abs=1e-9)
    np.testing.assert_array_equal(whole.frames, np.arange(60))
    np.testing.assert_array_equal(whole.poses, track.poses)
    np.testing.assert_array_equal(whole.diagnostics["ess"], track.diagnostics["ess"])
    np.testing.assert_array_equal(whole.joints[:36], track.joints[:36])
    np.testing.assert_array_equal(whole.joints[36:], second.joints[6:])
    assert json.loads(whole.provenance)["parts"] == [{"frame": 36, "apart_mm": 5.2}]
    track = lose(track, np.arange(45))
    assert find_seam(part_of(track, 0, 50), part_of(track, 30, 60)).frame >= 45
    assert find_seam(part_of(track, 0, 40), part_of(track, 30, 60)).distance == np.inf
    assert find_seam(part_of(track, 0, 20), part_of(track, 30, 60)).distance == np.inf
