"""Pairing of pictures by the numbers in their names, where one camera lacks some."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from helpers import footage

from cl import InputError
from psfs.sequence import Sequence

#: Numbers of the pictures of two cameras, and those that are read of each; None: in order.
CASES: dict[str, tuple[list[int], list[int], list[tuple[int, int]], str | None]] = {
    "one is missing": ([0, 1, 2, 3], [0, 2, 3], [(0, 0), (2, 2), (3, 3)], "c2 lacks 1"),
    "one is misnamed": ([0, 1, 2, 3], [0, 9, 2, 3], [(0, 0), (2, 2), (3, 3)], "c1 lacks 9"),
    "every second": ([0, 1, 2, 3], [0, 2], [(0, 0), (2, 2)], "c2 lacks 1 3"),
    "gaps of both": ([3, 10, 17], [3, 10, 17], [(3, 3), (10, 10), (17, 17)], None),
    "other beginnings": ([5, 6, 7], [90, 91, 92], [(5, 90), (6, 91), (7, 92)], None),
    "a shorter one": ([5, 6, 7], [5, 6], [(5, 5), (6, 6)], None),
    "times of day": ([1000, 1033, 1067], [1001, 1034, 1066],
                     [(1000, 1001), (1033, 1034), (1067, 1066)], None),
}  # fmt: skip


@pytest.mark.parametrize("kind", ["images", "masks"])
@pytest.mark.parametrize("case", CASES)
def test_numbers(tmp_path: Path, case: str, kind: str) -> None:
    first, second, read, said = CASES[case]
    rig = footage.rig(2)
    footage.write_toml(tmp_path / "calibration.toml", footage.tables(rig))
    levels: dict[int, tuple[int, int]] = {}
    for view, numbers in enumerate((first, second)):
        for number in numbers:
            value = 2 + len(levels)  # masks of 0 and 1 are read as of 0 and 255
            levels[value] = view, number
            path = tmp_path / kind / rig.names[view] / f"shot_{number}.png"
            footage.write_image(path, value)
    if kind == "images":  # of one level, as every background
        shutil.copytree(tmp_path / kind, tmp_path / "background")
    sequence = Sequence.open(tmp_path)
    shown = []
    for frame in sequence.frames():
        pictures = frame.images[..., 0] if frame.images is not None else frame.masks
        shown.append(tuple(levels[int(view[0, 0])][1] for view in pictures))
    assert shown == read
    names = {"c1": rig.names[0], "c2": rig.names[1]}
    notes = [note for note in sequence.timing_notes if "numbers in their names" in note]
    if said is None:
        assert not notes
    else:
        camera, what = said.split(" ", 1)
        assert f"{names[camera]} {what}" in notes[0]


@pytest.mark.parametrize(
    ("extra", "said"),
    [("0001~.png", "has the number of 0001.png"), ("thumbs.png", "has no number")],
)
def test_a_picture_too_many(tmp_path: Path, extra: str, said: str) -> None:
    """A copy among one camera's pictures would shift all that follow."""
    rig = footage.rig(2)
    footage.write_take(tmp_path, rig, np.zeros((2, 4, 48, 64), np.uint8))
    assert Sequence.open(tmp_path).timing_notes == []
    folder = tmp_path / "masks" / rig.names[1]
    shutil.copy(folder / "0002.png", folder / extra)
    with pytest.raises(InputError, match=f"{extra}: {said}; expected one picture for each frame"):
        Sequence.open(tmp_path)
    (folder / extra).unlink()
    (folder / "0000.png").rename(folder / "0004.png")
    (note,) = Sequence.open(tmp_path).timing_notes
    assert "begin differently" in note


def test_a_video_of_one_frame(tmp_path: Path) -> None:
    sequence = Sequence.open(footage.native(tmp_path, frames=1))
    assert len(sequence) == 1 and sequence.read(0).images is not None
