"""`apf batch`: how many people of a take."""

from __future__ import annotations

from pathlib import Path

import pytest

from apf.cli.batch.take import TakeJob
from cl import InputError


def job(words: tuple[str, ...], part_frames: int | None = None) -> TakeJob:
    folder = Path("take")
    return TakeJob("take", folder, Path("out"), Path("log"), words, part_frames=part_frames)


def test_as_many_people_as_are_seen_by_default_and_one_in_parts() -> None:
    assert job(()).arguments().people == "auto"
    assert job(("--people=3",)).arguments().people == "3"
    assert job((), part_frames=100).arguments().people == "1"
    with pytest.raises(InputError, match="--people is 2; a take that is cut by --part-frames"):
        job(("--people=2",), part_frames=100).arguments()
