"""--people: what is refused before anything is opened, and what is said of another number."""

from pathlib import Path

import numpy as np
import pytest
from helpers import tracks

from apf.cli import main
from apf.takes import people


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


def test_who_was_not_tracked_to_the_end_is_seen_so_far(tmp_path: Path) -> None:
    """An interrupt in the first of two people."""
    frames = np.arange(6)
    found = people.Persons(range(6), (people.Person(frames, None),) * 2)  # type: ignore[arg-type]
    gathered = found.gather([tracks.walker(4)], ["bad"])
    assert gathered.seen[0].tolist() == [0, 1, 2, 3]
    assert gathered.counts.tolist() == [1, 1, 1, 1, 0, 0]
