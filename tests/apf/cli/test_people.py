"""--people: what is refused before anything is opened."""

from __future__ import annotations

from pathlib import Path

import pytest

from apf.cli import main
from apf.cli.takes.take_report import TakeLine
from psfs.cli.commandline import progress_bar


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


def test_each_persons_frames_are_counted_from_the_first() -> None:
    bar = progress_bar()
    line = TakeLine(bar)
    for _ in range(2):
        line.n_frames = 3
        for _ in range(3):
            line("tracking back")
        (task,) = bar.tasks
        assert (task.completed, task.total) == (3, 3)
        line("judging")
