"""--people: what is refused before anything is opened, and what is said of another number."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import tracks

from apf.cli import main
from apf.cli.take_report import TakeLine
from apf.request import TrackRequest
from apf.takes import people
from apf.takes.job import TrackJob
from apf.tracking.progress import estimate_time_left
from psfs.cli.commandline import progress_bar
from psfs.people.people import People, Person


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--people", "0"], "--people is 0; expected 1 to 20, or auto"),
        (["--people", "many"], "--people is many; expected"),
        (["--people", "2", "--height", "1.8"], "--height applies only to one person"),
        (["--people", "2", "--objective", "sp"], "--objective sp tracks one person"),
    ],
)
def test_impossible_numbers_are_refused(
    flags: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["track", str(tmp_path), "-o", str(tmp_path / "out"), *flags]) == 2
    assert said in capsys.readouterr().err


def test_the_time_left_follows_the_pace() -> None:
    """Of ten units one takes a second; then each takes three."""
    assert estimate_time_left(0, 0, 0, 10, 1) == 10
    assert estimate_time_left(0.5, 0, 0, 10, 1) == 9.5
    assert estimate_time_left(9, 0, 0, 10, 1) == 9  # the piece underway takes no less than none
    for done, off in ((2, 0.4), (6, 0.2), (9, 0.15)):
        left = estimate_time_left(3 * done, 3 * done, done, 10, 1)
        assert left == pytest.approx(3 * (10 - done), rel=off)


@pytest.mark.parametrize("n_seen", [1, 2, 3])
def test_another_number_than_is_seen_is_said(
    n_seen: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """--people 2 splits one person, and leaves a third one out."""
    one = Person(np.arange(3), {})
    seen = People(range(3), None, (one,) * n_seen)  # type: ignore[arg-type]
    followed = People(range(3), None, (one,) * 2)  # type: ignore[arg-type]
    monkeypatch.setattr(people, "count_people", lambda session: seen)
    monkeypatch.setattr(people, "follow_several", lambda session, number: followed)
    monkeypatch.setattr(people, "separate", lambda session, found: [session] * len(found))
    session = SimpleNamespace(sequence=SimpleNamespace(name="duo", subject="person"))
    request = TrackRequest(folders=(Path("duo"),), people=2)
    job = TrackJob(request, None, TakeLine(progress_bar()))  # type: ignore[arg-type]
    found = people.find_persons(job, session, None)  # type: ignore[arg-type]
    assert found is not None and len(found.everybody) == 2
    said = capsys.readouterr().err.replace("\n", " ")
    assert ("duo: --people is 2; without it" in said) is (n_seen != 2)


def test_who_was_not_tracked_to_the_end_is_seen_so_far(tmp_path: Path) -> None:
    """An interrupt in the first of two people."""
    frames = np.arange(6)
    found = people.Persons(range(6), (people.Person(frames, None),) * 2)  # type: ignore[arg-type]
    gathered = found.gather([tracks.walker(4)], ["bad"])
    assert gathered.seen[0].tolist() == [0, 1, 2, 3]
    assert gathered.counts.tolist() == [1, 1, 1, 1, 0, 0]
