"""How far limbs are believed: by what else was found, by how they tremble, by another track."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import bodies, tracks

from apf.body.limbs import limb_ends, limb_names
from apf.body.toml import load_body
from apf.tracking.limb_confidence import LOST, limb_confidence, limb_margins
from apf.tracking.smoothing import smooth_track
from apf.tracking.track import Track

BODY = load_body("song31")
ARM = limb_names(BODY).index("left arm")


def test_margins_are_those_of_the_best_candidate_elsewhere() -> None:
    """What has the arm nearby does not count, however well it fits; errors are shares of that of
    the candidate that was taken, here the second."""
    raised, nearby, bent = (bodies.bent(BODY, l_upper_arm__rx=by) for by in (1.2, 0.05, 0.9))
    legs = bodies.bent(BODY, r_thigh__ry=0.8)
    candidates = np.stack([nearby, BODY.rest_pose, raised, bent, legs])[None]
    errors = np.array([[4.01, 4.0, 6.0, 5.0, 4.4]])
    margins = limb_margins(BODY, BODY.rest_pose[None], candidates, errors)[0]
    assert margins[ARM] == pytest.approx(0.25)
    assert margins[limb_names(BODY).index("right leg")] == pytest.approx(0.1)
    assert np.isinf(margins[limb_names(BODY).index("right arm")])
    worse = limb_margins(BODY, raised[None], candidates, errors)[0]
    assert worse[ARM] == 0.0  # what was not taken fits better


def test_what_speaks_against_a_limb(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each by itself, a mean over a moment; whatever the rate of the frames."""
    for fps in (30, 60):
        n = 2 * fps
        times = np.arange(n) / fps
        ends = np.zeros((n, 4, 3))
        ends[:, :, 0] = times[:, None]  # at 1 m/s
        margins = np.full((n, 4), 0.3)
        margins[n // 2 :, 0] = 0.02
        ends[n // 2 :, 1, 2] += 0.06 * (-1.0) ** np.arange(n - n // 2)
        stricter = (-18.4, 36.1, -0.033, 0.0)
        monkeypatch.setattr("apf.tracking.limb_confidence._ONE_PASS", stricter)
        believed = limb_confidence(margins, ends, times)
        assert believed[: n // 4].min() > 0.75 and believed[:, 2:].min() > 0.75
        assert believed[3 * n // 4 :, :2].max() < 0.45
        crossing = [int(np.argmax(believed[:, k] < LOST)) / n for k in range(2)]
        np.testing.assert_allclose(crossing, 0.5, atol=0.1)


def test_ways_that_disagree_are_not_believed() -> None:
    """Where the other way is not known, margin and jitter alone say it."""
    margins, apart = np.full((2, 30, 4), [[[0.3]], [[0.03]]])
    ends, times = np.zeros((30, 4, 3)), np.arange(30) / 30
    margins[:, ARM + 1] = apart[:, ARM - 1] = np.nan
    apart[:, ARM] = 0.4
    found, alone = (limb_confidence(margins, ends, times, other) for other in (apart, None))
    assert np.delete(found, ARM, 1).min() > 0.9 and found[:, ARM].max() < 0.1
    np.testing.assert_array_equal(found[:, ARM - 1], alone[:, ARM - 1])


def test_a_track_keeps_what_it_said(tmp_path) -> None:
    """In its file, and when it is smoothed, though its joints tremble no more."""
    walker = tracks.walker()
    margins = np.full((30, 4), 0.3)
    margins[10:, ARM] = 0.01
    joints = walker.joints.copy()
    joints[:, limb_ends(BODY)[ARM - 1], 2] += 0.05 * (-1.0) ** np.arange(30)
    diagnostics = {**walker.diagnostics, "limb_margin": margins}
    track = replace(walker, joints=joints, diagnostics=diagnostics)
    assert track.lost_limbs[20:, ARM].all() and not track.lost_limbs[:5, ARM].any()
    judged = track.judged
    judged.save(tmp_path / "x.npz")
    for same in (Track.open(tmp_path / "x.npz"), smooth_track(judged)):
        np.testing.assert_array_equal(same.limb_confidence, track.limb_confidence)
    assert not walker.lost_limbs.any()  # which states nothing
