"""--people of `apf track` and `apf batch`: what is refused, and each person's errors."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import tracks
from helpers.commands import fail, state_track

from apf.cli.batch import ListedTake, make_request
from apf.cli.batch_take import compare_with_truth
from apf.request import BatchRequest, TrackRequest
from apf.takes import people
from apf.tracking.track import Track
from cl import InputError


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--people", "0"], "--people is 0; expected 1 to 20, or auto"),
        (["--people", "many"], "--people is many; expected"),
        (["--people", "2", "--height", "1.8"], "--height applies only to one person"),
        (["--people", "2", "--objective", "sp"], "--objective sp tracks one person"),
    ],
)
def test_impossible_numbers_are_refused(flags: list[str], said: str, tmp_path: Path) -> None:
    assert said in fail("apf", "track", tmp_path, "-o", tmp_path / "out", *flags)


def test_who_was_not_tracked_to_the_end_is_seen_so_far(tmp_path: Path) -> None:
    """An interrupt in the first of two people."""
    frames = np.arange(6)
    found = people.Persons(range(6), (people.Person(frames, None),) * 2)  # type: ignore[arg-type]
    gathered = found.gather([tracks.walker(4)], ["bad"])
    assert gathered.seen[0].tolist() == [0, 1, 2, 3]
    assert gathered.counts.tolist() == [1, 1, 1, 1, 0, 0]


def request(*words: str, part_frames: int | None = None) -> TrackRequest:
    batch = BatchRequest(folders=(), part_frames=part_frames)
    stated = state_track("take", "-o", "out", *words)
    return make_request(batch, ListedTake(Path("take"), stated=stated), Path("out"))


def test_as_many_people_as_are_seen_by_default_and_one_in_parts() -> None:
    assert request().people == "auto"
    assert request("--people=3").people == 3
    assert request(part_frames=100).people == 1
    with pytest.raises(InputError, match="--people is 2; a take that is cut by --part-frames"):
        request("--people=2", part_frames=100)
    with pytest.raises(InputError, match="apf batch: --people is 0; expected 1 to 20"):
        request("--people=0")  # before a cluster is started


def test_each_person_has_an_error_of_their_own(tmp_path: Path) -> None:
    """Two people, two seeds; the first of the true ones is absent in half of the frames."""
    n = 4
    frames, offset = np.arange(n), np.array([1.0, 0, 0])
    first, off = tracks.walker(n), np.array([0.01, 0, 0])
    second = replace(first, joints=first.joints + offset)
    joints = np.stack([first.joints, second.joints], axis=1)
    joints[2:, 0] = np.nan
    path = tmp_path / "truth.npz"
    np.savez(path, joint_names=np.array(first.joint_names), joints=joints, fps=60.0)

    def finished(track: Track, seen: np.ndarray) -> Any:
        runs = [track, replace(track, joints=track.joints + off)]
        judged = [SimpleNamespace(quality=SimpleNamespace(seen=seen))] * 2
        take = SimpleNamespace(tracks=runs, sequence=SimpleNamespace(folder=tmp_path))
        return SimpleNamespace(take=take, judgements=judged)

    everybody = [finished(second, frames), finished(first, frames[:2])]
    found = compare_with_truth(everybody)
    errors = [[of and 1000 * of.mean_error for of in person] for person in found]
    np.testing.assert_allclose(errors, [[0, 10], [0, 10]], atol=1e-6)
    path.unlink()
    assert compare_with_truth(everybody) == [[None, None], [None, None]]
