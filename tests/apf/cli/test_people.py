"""--people: what is refused before anything is opened."""

from __future__ import annotations

from pathlib import Path

import pytest

from apf.cli import main


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
