"""--people of `apf track` and `apf batch`: what is refused, and each person's errors."""

from pathlib import Path

import numpy as np
import pytest
from helpers import tracks
from helpers.commands import fail, state_track

from apf.cli.batch import ListedTake, make_request
from apf.request import BatchRequest, TrackRequest
from apf.takes import people
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
