"""A take may begin and end with nobody: the start is where somebody is seen best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import scenes
from helpers.tracks import walker

from apf.body.model import BodyModel, Cone
from apf.filters.method import Method
from apf.initialisation.shape_model import ShapeModel
from apf.initialisation.start import Start, StartError
from apf.tracking import take
from apf.tracking.pipeline import Tracked, TrackingRun, TrackingTask
from apf.tracking.settings import TakeSettings
from apf.tracking.take import (
    StartedTake,
    Take,
    choose_starts,
    complete_takes,
    rank_starts,
    track_again,
)
from apf.tracking.track import Track
from cl import DeviceError, NumpyDevice
from psfs.session import Session, SessionSettings
from psfs.volume import automatic_grid
from psfs.voxels.grid import VoxelGrid

GRID = VoxelGrid.covering(np.array([-1.5, -1.5, 0]), np.array([1.5, 1.5, 2.0]), 0.05)
FPS, N = 20.0, 100


def block(height: float, x: float = 0.0) -> np.ndarray:
    """Flat indices of the voxels of a block that stands at x."""
    inside = (np.abs(GRID.centres() - [x, 0, 0]) < [0.2, 0.2, height]).all(1)
    return np.flatnonzero(inside)


def session_of(shown: dict[range, np.ndarray]) -> Session:
    """A session whose frames show these voxels."""

    class Reader:
        rig, fps, folder, name = scenes.ring(4, (200, 150)), FPS, "nowhere", "nowhere"
        volume = None

        def __len__(self) -> int:
            return N

        def reader(self, learning: bool) -> Reader:
            return self

        def __enter__(self):
            return lambda index: index

        def __exit__(self, *error: object) -> None:
            pass

    def reconstruct(index: int) -> SimpleNamespace:
        indices = next((v for frames, v in shown.items() if index in frames), np.zeros(0, int))
        return SimpleNamespace(grid=GRID, cloud=lambda: SimpleNamespace(grid=GRID, indices=indices))

    session = Session(Reader(), NumpyDevice(), SessionSettings())  # type: ignore[arg-type]
    session.replace_result(automatic_grid, GRID)
    session.reconstructor = lambda grid: reconstruct  # type: ignore[method-assign]
    return session


def with_error(
    error: float, misfit: float = 1.0, off: float = 0.0, poses: np.ndarray | None = None
) -> Tracked:
    """A walker's track of this cost, whose joints are `off` m, or who has other poses."""
    track = walker()
    costs = np.full((len(track), 1), -float(error))
    known = {"best_log_weight": costs, "misfit": np.full(len(track), misfit)}
    poses = track.poses if poses is None else poses
    joints, diagnostics = track.joints + off, track.diagnostics | known
    return Tracked([replace(track, joints=joints, poses=poses, diagnostics=diagnostics)])


def start_in(row: int, *rivals: Start) -> Start:
    """A start in one frame of the walker's track."""
    track = walker()
    shape = np.zeros(len(ShapeModel(track.its_body).deviation))
    return Start(track.its_body, shape, track.poses[[row]], (row,), 0, 1.1, 1.7, rivals=rivals)


def take_of(start: Start, *more: Any, shown: dict[range, np.ndarray] | None = None) -> StartedTake:
    task = TrackingTask(start.body, start.pose, Method(), [0], frame=start.frame)
    return StartedTake(session_of(shown or {}), task, start, True, *more)


def test_the_start_is_where_the_person_stands_whole() -> None:
    """The person comes in at the border, crouches, and stands."""
    shown = {range(20, 40): block(1.7, 1.4), range(40, 60): block(0.9), range(60, 95): block(1.7)}
    ranked = rank_starts(session_of(shown))
    assert all(55 <= frame <= 75 for frame in ranked[:2]) and ranked == sorted(ranked)
    with pytest.raises(StartError, match="nobody is seen in 25 frames"):
        rank_starts(session_of({range(N): block(0.1)}))


@pytest.mark.parametrize("ended", [KeyboardInterrupt(), DeviceError("the device was lost")])
def test_the_first_pass_counts_alone(monkeypatch: pytest.MonkeyPatch, ended: BaseException) -> None:
    def end(*args: object) -> Take:
        raise ended

    monkeypatch.setattr(take, "track_once", end)
    track = walker()
    body, session = track.its_body, session_of({})
    session.sequence.folder = Path("nowhere")
    task = TrackingTask(replace(body, name="of the start"), track.poses[0], Method(), [0])

    def complete(tracks: Sequence[Track]) -> list[Track]:
        return [replace(each, fps=7.0) for each in tracks]

    of_take = session.sequence, body, track.poses[0], None, [track], 1.0
    first = Take(*of_take, complete=complete)
    (found,) = complete_takes(track_again([StartedTake(session, task)], [first]))
    assert found.tracks[0].fps == 7.0
    assert found.tracks[0].interrupted and found.error is (
        ended if isinstance(ended, DeviceError) else None
    )
    np.testing.assert_array_equal(found.tracks[0].poses, track.poses)


@pytest.mark.parametrize("ended", [KeyboardInterrupt(), DeviceError("the device was lost")])
def test_ended_tracks_decide_nothing(monkeypatch: pytest.MonkeyPatch, ended: BaseException) -> None:
    track = walker()
    error = ended if isinstance(ended, DeviceError) else None
    tracked = Tracked([track if error else track.as_interrupted], error)
    monkeypatch.setattr(take, "track_people", lambda *args: [tracked])
    with pytest.raises(type(ended)):
        choose_starts([take_of(start_in(0, start_in(0)))])


def test_the_take_decides_between_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """They have other headings, or are in another frame. Cost is error times misfit. The
    best one's body is fitted to the take for as long as it costs less."""
    track = walker()
    results = [with_error(error, 0.2, off) for error, off in ((20, 0), (16, 1.0), (17, 1.01))]
    costs = list[float]()

    def track_people(runs: list[TrackingRun], progress: object) -> list[Tracked]:
        return results if len(runs) == 3 else [with_error(costs.pop(0), 0.2, 1.0)]

    fitted, growth = list[Start](), [0.1, 0.1, 0.1, 0.1, 1e-3, 0.1]

    def refit(template: BodyModel, start: Start, *voxels: object) -> Start:
        grown = start.shape + np.eye(len(start.shape))[0] * growth.pop(0)
        fitted.append(replace(start, shape=grown, poses=start.poses + 1e-3))
        return fitted[-1]

    monkeypatch.setattr(take, "track_people", track_people)
    monkeypatch.setattr(take, "refit_start", refit)
    alone = replace(take_of(start_in(4)), personal=False)
    both = [alone, take_of(start_in(4, start_in(5)), (start_in(7),), TakeSettings())]
    costs[:] = [16.1]
    first, chosen = choose_starts(both)
    assert first is alone and len(fitted) == 1
    assert chosen.start is not None  # the third is the same track
    assert chosen.start.rival == pytest.approx(20 / 16)
    assert chosen.task.frame == 5
    np.testing.assert_array_equal(chosen.task.pose, track.poses[5])
    costs[:] = [15.0, 14.0, 14.5]
    _, chosen = choose_starts(both)
    assert chosen.start is fitted[2] and not costs
    np.testing.assert_allclose(chosen.task.pose, track.poses[5] + 2e-3)
    _, chosen = choose_starts(both)  # the body that is fitted is the same
    np.testing.assert_array_equal(chosen.task.pose, track.poses[5])
    results[1], costs[:] = with_error(16.0, 0.4, 1.0), [99.0]
    _, chosen = choose_starts(both)
    np.testing.assert_array_equal(chosen.task.pose, track.poses[7])
    assert chosen.task.frame == 7


@pytest.mark.parametrize(("off", "n_left"), [((1.0, 1.01), 2), ((0.5, 1.01), 1), ((0.5, 2), 0)])
def test_starts_are_sought_until_one_confirms_the_best(
    monkeypatch: pytest.MonkeyPatch, off: tuple[float, float], n_left: int
) -> None:
    """Another frame's start has to lead to the same track; frames are tried one after the other."""
    results = [with_error(9.0, 0.2, at) for at in (*off, 3.0)]
    results[:0] = [with_error(8.0, 0.2, 1.0), with_error(9.0)]
    monkeypatch.setattr(
        take, "track_people", lambda runs, progress: [results.pop(0) for run in runs]
    )
    monkeypatch.setattr(take, "_refit", lambda *args: [])
    more = map(start_in, (5, 6, 7))
    (chosen,) = choose_starts([take_of(start_in(4, start_in(4)), more)])
    assert chosen.task.frame == 4 and len(results) == len(list(more)) == n_left


@pytest.mark.parametrize(("error", "frame"), [(9.0, 4), (7.0, 5)])
def test_people_walk_forward(monkeypatch: pytest.MonkeyPatch, error: float, frame: int) -> None:
    """Who faces away and moves backwards through the take must fit clearly better."""
    track = walker()
    poses = track.poses + np.pi * np.eye(len(track.dof_names))[track.dof_names.index("pelvis.rz")]
    both = [with_error(10.0), with_error(error, poses=poses)]
    monkeypatch.setattr(take, "track_people", lambda *args: both)
    monkeypatch.setattr(take, "_refit", lambda *args: [])
    (chosen,) = choose_starts([take_of(start_in(4, start_in(5)))])
    assert chosen.task.frame == frame


@pytest.mark.parametrize(("costs", "sought_anew"), [((0.5, 0.49), True), ((0.5, 0.4), False)])
def test_what_the_person_carries_becomes_a_part_of_the_body(
    monkeypatch: pytest.MonkeyPatch, costs: tuple[float, float], sought_anew: bool
) -> None:
    """Arms were where the load is: a start that is sought anew counts, unless it costs more."""
    track = walker()
    tracked = [[with_error(error) for error in errors] for errors in ((1.0,), costs, (1.0,))]
    load = [replace(track.its_body.cones[0], name="load_1", bone=0)]
    sought, started_from = list[BodyModel](), list[int]()

    def find(body: BodyModel, *shown: object) -> list[Cone]:
        sought.append(body)
        return load

    def start_again(session: Session, template: BodyModel, **settings: object) -> Start:
        started_from.append(session.frames.start)
        return replace(start, template=template, shape=np.append(start.shape, 0.0), frames=(9,))

    monkeypatch.setattr(take, "track_people", lambda *args: tracked.pop(0))
    monkeypatch.setattr(take, "find_load", find)
    monkeypatch.setattr(take, "initialise", start_again)
    start = start_in(4)
    (chosen,) = choose_starts([take_of(start, (), TakeSettings(), shown={range(N): block(1.7)})])
    assert [body.cone_names for body in sought] == [start.body.cone_names]  # once
    assert chosen.task.body.cone_names == [*start.body.cone_names, "load_1"]
    assert chosen.start is not None and started_from == [4]
    assert chosen.start.rival == np.inf  # of the take
    if sought_anew:
        np.testing.assert_array_equal(chosen.task.pose, track.poses[4])
    assert len(chosen.start.poses) == (1 if sought_anew else 20)
    assert chosen.task.frame == chosen.start.frame and (chosen.start.frame == 9) == sought_anew
