"""Who is followed by `apf live`, and what is said of the others."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import tracks

from apf.cli import live_start
from apf.cli.live import compare_with_truth
from apf.evaluation.truth import load_people_truth
from apf.live.session import LiveResult
from psfs.people.people import People


def test_one_of_several_is_said_to_be_followed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    walker, session = tracks.walker(1), SimpleNamespace(rig=[None] * 4)
    session.sequence = SimpleNamespace(name="duo")
    monkeypatch.setattr(live_start, "select_beginning", lambda session, frames, seconds: session)
    for n_people, warned in ((1, False), (2, True)):
        one = SimpleNamespace(frames=np.arange(2))
        people = People(range(2), None, (one,) * n_people)  # type: ignore[arg-type]
        monkeypatch.setattr(live_start, "count_people", lambda session, people=people: people)
        live_start.warn_of_others(session, range(20), (walker.its_body, walker.poses[0]))  # type: ignore[arg-type]
        said = capsys.readouterr().err
        assert ("duo: 2 people are seen; one is followed, who begins at x " in said) is warned
        assert ("--people auto follows all" in said) is warned


def test_one_is_compared_with_the_nearest(tmp_path: Any) -> None:
    track = tracks.walker(4)
    joints = np.stack([track.joints + np.array([x, 0, 0]) for x in (1.0, 0.01)], axis=1)
    path = tmp_path / "truth.npz"
    np.savez(path, joint_names=np.array(track.joint_names), joints=joints, fps=track.fps)
    result = LiveResult(latencies=[0.0] * 4)
    errors = compare_with_truth([track], result, load_people_truth(path))
    assert errors["error_mm"] == pytest.approx(10, abs=0.01)
