"""Starts that could as well look elsewhere are decided by a longer look."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import bodies

from apf.initialisation import sequence
from apf.initialisation.config import StartConfig
from apf.initialisation.start import Start, StartError

SONG = bodies.named("song31")


def start(heading: float, rival: float) -> Start:
    pose = SONG.rest_pose.copy()
    pose[[axis.kind for axis in SONG.bones[0].axes].index("rz")] += heading
    return Start(SONG, pose, pose[None], 0.28, rival, 1.7, 1.0)


def decided(
    monkeypatch: pytest.MonkeyPatch, first: Start, again: Start | None, n_frames: int = 61
) -> tuple[Start, int]:
    """The start that is chosen, and how many were looked for."""
    looks: list[StartConfig] = []

    def found(session: Any, template: Any, config: StartConfig, **options: Any) -> Start:
        looks.append(config)
        if len(looks) == 1:
            return first
        if again is None:
            raise StartError("nobody")
        return again

    monkeypatch.setattr(sequence, "_find", found)
    skirt = SimpleNamespace(name="skirt", fps=60.0)
    session: Any = SimpleNamespace(sequence=skirt, frames=range(0, 2 * n_frames, 2))
    chosen = sequence.initialise(session, SONG)
    if len(looks) > 1:
        assert looks[1].frames.duration == pytest.approx(2.5 * looks[0].frames.duration)
        assert looks[1].frames.n_fitted == 2 * looks[0].frames.n_fitted
    return chosen, len(looks)


def test_a_sure_start_is_not_looked_at_again(monkeypatch: pytest.MonkeyPatch) -> None:
    first = start(0.0, 1.2)
    assert decided(monkeypatch, first, None) == (first, 1)


def test_a_longer_look_turns_the_person_about(monkeypatch: pytest.MonkeyPatch) -> None:
    first, again = start(0.0, 1.04), start(np.pi, 1.2)
    assert decided(monkeypatch, first, again) == (again, 2)


def test_a_longer_look_that_agrees_or_knows_less_changes_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first = start(0.0, 1.04)
    for again in (start(0.3, 1.2), start(np.pi, 1.01), None):
        assert decided(monkeypatch, first, again) == (first, 2)
    assert decided(monkeypatch, replace(first, rival=1.0), start(2.5, 1.1))[0].rival == 1.1
