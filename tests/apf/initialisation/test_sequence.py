"""The automatic start of a sequence: which frames it looks at."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import footage

import apf.initialisation.sequence as module
from apf.body.toml import load_body
from apf.initialisation.config import StartConfig
from apf.initialisation.sequence import initialise
from apf.initialisation.start import Start, StartError
from cl import Device, InputError
from psfs.sequence import Sequence
from psfs.session import Session, SessionSettings
from psfs.volume import automatic_grid
from psfs.voxels.grid import VoxelGrid

FRAMES, FPS = 90, 30


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    """Return a sequence of uniform pictures: the tests replace the search for a person."""
    folder = footage.native(tmp_path_factory.mktemp("walk") / "walk", 2, FRAMES)
    return Sequence.open(folder, fps=FPS)


@pytest.mark.parametrize("fails", [False, True])
@pytest.mark.parametrize(
    ("rises", "first_height", "broken"),
    [(False, 1.2, 99), (True, 1.2, 99), (False, 0.0, 99), (False, 1.2, 50)],
)
def test_who_stands_later_is_measured_there(
    sequence: Sequence,
    monkeypatch: pytest.MonkeyPatch,
    fails: bool,
    rises: bool,
    first_height: float,
    broken: int,
) -> None:
    """Heights and starts are made up; frames are told by their numbers; the `broken` one cannot be
    read."""
    template, tall = load_body("song31"), load_body("song31")
    calls = []

    def find(scene, voxels, noise, keep_shape, **rest) -> Start:
        own = keep_shape
        calls.append(([v.index for v in voxels], scene.body, own))
        if fails and rises and len(calls) == 1:
            raise StartError("nobody")
        body = scene.body if own else tall
        return Start(body, np.zeros(31), np.zeros((1, 31)), 0.1, 2.0, 1.0 + len(calls), 1.0)

    class Frame:
        def __init__(self, frame) -> None:
            if frame.index >= broken:
                raise InputError("broken")
            self.index = frame.index

    monkeypatch.setattr(module, "find_start", find)
    monkeypatch.setattr(Session, "reconstructor", lambda *a: Frame)
    monkeypatch.setattr(module, "store_voxels", lambda device, voxels: voxels)
    monkeypatch.setattr(
        module,
        "seen_height",
        lambda v, config: 1.7 if rises and 55 <= v.index < 65 else first_height,
    )
    session = Session(sequence, Device.best(), SessionSettings(selection=slice(2, None)))
    grid = VoxelGrid.covering(np.zeros(3), np.ones(3), 0.1)
    session.replace_result(automatic_grid, grid)
    start = initialise(session, template)
    first, _ = module.frames_to_fit(range(2, FRAMES), FPS, StartConfig().frames)
    assert calls[-1][0] == list(first)
    if not rises or fails:
        assert calls[-1][1] is template and not calls[-1][2] and len(calls) == 1 + (rises and fails)
        return
    (around, body, own), (_, kept, kept_own) = calls
    assert around[0] <= 55 and around[-1] >= 64 and len(around) == len(first)
    assert body is template and not own and kept is tall and kept_own
    assert start.body is tall and start.seen == 2.0
