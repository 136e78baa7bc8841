"""The page of a live run shows the newest pose, and ends the run."""

from contextlib import closing

import numpy as np
import pytest
from helpers import tracks
from helpers.scenes import ring
from helpers.waiting import wait_for

pytest.importorskip("viser", reason="viser is not installed")

from apf.filters.base import Estimate
from apf.live.session import STAGES, LiveResult, LiveStart
from apf.live.timeline import Timeline
from apf.studio.live import LivePage


def test_newest_pose_is_shown() -> None:
    track, stopped = tracks.walker(5), []
    body, layers = track.its_body, 4 * [np.zeros(4)]
    result, timeline = LiveResult(sizes=[(0, 60, 4)]), Timeline(STAGES)
    start = LiveStart(None, [(body, track.poses[0])])
    with closing(LivePage(start, ring(), lambda: stopped.append(1))) as page:
        assert np.allclose(page.nodes[0].joints.points, track.joints[0], atol=1e-5)
        page(result, timeline)
        for row in (1, 3):
            result.frames.append(row)
            timeline.add_result(row, 0.0, 0.02 + row / 30)
            pose = Estimate(body, track.poses[row], *layers, confidence=0.25, lost=row == 3)
            result.estimates.append([pose])
        wait_for(lambda: "lost" in page.status.content)
        assert np.allclose(page.nodes[0].joints.points, track.joints[3], atol=1e-5)
        assert "the person is lost" in page.status.content and "2 poses" in page.status.content
        page.press_record()  # from the next pose on
        assert page.takes == [(4, 4)]
        result.frames += [4, 6, 7]
        assert page.takes == [(4, 7)]
        page.press_record()
        result.frames.append(9)
        assert page.takes == [(4, 7)]
        page.press_end()
        assert stopped == [1]
