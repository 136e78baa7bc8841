"""Trackers that know when they have lost the person."""

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import scenes
from helpers.walkers import GRID, SONG, surface_voxels, walker

import apf.tracking.recovery
from apf.body.kinematics import posed_joints
from apf.filters.base import Estimate
from apf.filters.method import Method
from apf.initialisation.kept_voxels import StoredVoxels
from apf.initialisation.start import StartError
from apf.scene import Scene
from apf.tracking.pipeline import build_track
from apf.tracking.recovery import (
    GLOBAL_RESTART,
    LOCAL_RESTART,
    TRACKED,
    RecoveringTracker,
    make_recovering_tracker,
)
from cl import Device


@dataclass
class OnALine:
    """Follows a person on a line, if he is not farther than `reach` away."""

    reach: float
    n_layers: int = 2
    least: float = 0.2
    at: float = 0.0

    def start(self, pose: np.ndarray) -> None:
        self.at = float(pose[0])

    def step(self, person: float) -> Estimate:
        if abs(person - self.at) <= self.reach:
            self.at = person
        misfit = min(2.0, self.least + abs(person - self.at))
        ones = np.ones(self.n_layers)
        pose = np.concatenate([[self.at], SONG.rest_pose[1:]])
        return Estimate(SONG, pose, 0.1 * ones, ones, ones, ones, misfit=misfit)


def run(tracker: RecoveringTracker, places: Sequence[float]) -> list[Estimate]:
    tracker.start(np.zeros(1))
    return [tracker.step(place) for place in places]


def search_everywhere(person: float) -> list[np.ndarray]:
    return [np.array([-9.0]), np.array([person + 0.5])]


@pytest.mark.parametrize(
    ("settings", "places", "poses", "lost", "restarted"),
    [
        # A jump is found around the last good pose.
        ({}, (0.0, 0.05, 0.9, 0.95), (0.0, 0.05, 0.9, 0.95), [], {2: LOCAL_RESTART}),
        # Who is gone is lost, and the last good pose held.
        ({}, (0.0, 0.05, 50.0, 50.0, 0.1, 0.15), (0.0, 0.05, 0.05, 0.05, 0.1, 0.15), [2, 3], {}),
        ({"recovers": False}, (0.0, 50.0), (0.0, 0.0), [], {}),
        # Frames from 40 on show too little for anybody to be searched.
        ({"everywhere": search_everywhere, "enough": lambda place: place < 40},
         (0.05, 50.0, 51.0, 0.1), (0.05, 0.05, 0.05, 0.1), [1, 2], {}),
        # Who is elsewhere is searched everywhere.
        ({"everywhere": search_everywhere}, (0.0, 50.0, 50.05), (0.0, 50.0, 50.05), [],
         {1: GLOBAL_RESTART}),
    ],
)  # fmt: skip
def test_people_who_jump_leave_and_come_back(
    settings: dict[str, Any],
    places: tuple[float, ...],
    poses: tuple[float, ...],
    lost: list[int],
    restarted: dict[int, int],
) -> None:
    found = run(
        RecoveringTracker(OnALine(0.1), lambda: OnALine(1.0, n_layers=4), **settings), places
    )
    assert [e.pose[0] for e in found] == list(poses)
    assert [k for k, e in enumerate(found) if e.lost] == lost
    enough = settings.get("enough", lambda place: True)
    assert [e.present for e in found] == [enough(at) for at in places]
    assert [e.restart for e in found] == [restarted.get(k, TRACKED) for k in range(len(places))]
    assert len({len(e.ess) for e in found}) == 1  # though the wide search has more layers
    assert all(
        (e.confidence < 0.5) == (abs(at - e.pose[0]) > 1)
        for e, at in zip(found, places, strict=True)
    )


def test_before_there_is_a_good_frame_the_misfit_of_an_accepted_start_is_no_sign_of_loss() -> None:
    found = run(RecoveringTracker(OnALine(0.1), lambda: OnALine(0.2)), [0.5, 0.5, 5.0])
    assert [estimate.lost for estimate in found] == [False, False, True]


@pytest.mark.parametrize(("misfit", "stands_still"), [(0.7, False), (0.95, True)])
def test_a_misfit_that_two_searches_find_is_followed(misfit: float, stands_still: bool) -> None:
    """Hulls of few cameras misfit the right pose; from `WORST` on nobody is seen."""
    near, wide = OnALine(0.1), OnALine(1.0)
    tracker = RecoveringTracker(near, lambda: wide)
    assert not run(tracker, [0.0])[0].lost
    near.least = wide.least = misfit
    found = [tracker.step(place) for place in (0.05, 0.1, 0.15)]
    assert all(e.lost and e.restart == TRACKED for e in found)
    assert [e.pose[0] for e in found] == ([0.0] * 3 if stands_still else [0.05, 0.1, 0.15])


def test_who_comes_back_is_tracked_again(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames 4 to 6 show nobody; from frame 7 on the person stands a metre further on, where the
    search everywhere, which test_start.py tests, finds him roughly."""

    def found(_: Scene, voxels: list[StoredVoxels], *__: object, **___: object) -> object:
        if not len(voxels[0].cloud()):
            raise StartError("nobody")
        return SimpleNamespace(pose=walker(7, 1.05))

    monkeypatch.setattr(apf.tracking.recovery, "find_start", found)
    poses = [*(walker(k) for k in range(4)), *[None] * 3, *(walker(k, 1.0) for k in range(7, 10))]
    method = Method.create(n_particles=100, n_layers=6)
    tracker = make_recovering_tracker(Scene(device, scenes.ring(4), GRID, SONG), method)
    tracker.start(walker(0))
    estimates = [tracker.step(surface_voxels(device, pose)) for pose in poses]
    track = build_track(SONG, 60.0, list(range(len(poses))), estimates, {})
    # The search everywhere is tried in every fifth lost frame: in frames 4 and 9.
    assert track.lost.tolist() == [False] * 4 + [True] * 5 + [False]
    assert GLOBAL_RESTART in track.diagnostics["restart"]
    assert np.all(track.confidence[track.lost] < 0.5)
    assert np.all(track.confidence[~track.lost] >= 0.5)
    assert np.isnan(track.covariance[track.lost]).all()
    assert np.isfinite(track.covariance[~track.lost]).all()
    true = posed_joints(SONG, np.stack([walker(0), walker(9, 1.0)]))
    for row, place in ((0, 0), (-1, 1)):
        assert np.linalg.norm(track.joints[row] - true[place], axis=-1).mean() < 0.08
