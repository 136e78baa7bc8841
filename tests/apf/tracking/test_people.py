"""The tracks of several people and their files."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers import tracks

from apf.tracking.people import PeopleTracks, holds_people, list_people, parse_spans
from apf.tracking.track import PEOPLE, Track, spans
from cl import InputError


def test_saved_people_are_opened_again(tmp_path: Path) -> None:
    seen = (np.arange(10), np.array([2, 3, 7]))
    people = PeopleTracks(
        (tracks.walker(10), tracks.walker(6, 2)), np.arange(10), seen, 1, ("good", "")
    )
    people.save(tmp_path)
    assert holds_people(tmp_path)
    again = PeopleTracks.open(tmp_path)
    assert [len(track) for track in again] == [10, 6]
    assert again.counts.tolist() == [1, 1, 2, 2, 1, 1, 1, 2, 1, 1]
    assert again.objects == 1
    with pytest.raises(InputError, match=r"of several people; expected one, as .*person1"):
        Track.open(tmp_path)
    assert again.select_seen(1).frames.tolist() == [2, 3, 7]
    listed = json.loads((tmp_path / PEOPLE).read_text())
    assert listed["frames_with"] == {"1": 7, "2": 3}
    assert [person.get("verdict") for person in listed["persons"]] == ["good", ""]
    (alone,) = PeopleTracks.open(tmp_path / "person2")  # of one person, in the same way
    assert len(alone) == 6
    assert repr(again) == "<PeopleTracks of 2 in 10 frames: seen in 10, 3>"
    PeopleTracks(people.tracks[:1], np.arange(10), seen[:1]).save(tmp_path)
    assert list_people(tmp_path) == [tmp_path / "person1"]  # person2 is of the run before


@pytest.mark.parametrize("frames", [[], [3], [0, 1, 2], [1, 2, 5, 7, 8]])
def test_spans_are_read_back(frames: list[int]) -> None:
    assert parse_spans(spans(frames)).tolist() == frames


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"frames": "3 to 5"}, "frames"),
        ({"persons": []}, "persons"),
        ({"persons": [{"folder": "../elsewhere", "frames": 1, "seen": "1"}]}, "folder"),
        ({"people": 99}, "99 people in the folders person1"),
        ({"frames": "9-2"}, "frames 9-2; expected them ascending"),
        ({"frames": ", ".join(["0-9999999"] * 500)}, "expected them ascending"),
    ],
)
def test_other_lists_are_refused(changed: dict[str, object], said: str, tmp_path: Path) -> None:
    people = PeopleTracks((tracks.walker(3),), np.arange(3), (np.arange(3),))
    people.save(tmp_path)
    path = tmp_path / PEOPLE
    path.write_text(json.dumps({**json.loads(path.read_text()), **changed}))
    with pytest.raises(InputError, match=said) as error:
        PeopleTracks.open(tmp_path)
    assert str(error.value).startswith(f"{path}: ")
