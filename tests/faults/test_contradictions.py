"""Tracks, people, corrections and models that contradict themselves."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers import tracks
from helpers.opensim import write_model

from apf.formats.opensim.model import read_model
from apf.keypoints.opening import read_raw
from apf.tracking.retracking import Correction, Corrections
from cl import InputError
from psfs.voxels.grid import VoxelGrid


@pytest.mark.parametrize(
    ("points", "bad", "said"),
    [
        ([], [(0, 10**12)], "bad frames 0 to 1000000000000; expected .* from 0 to 5"),
        ([], [(500, 600)], "bad frames 500 to 600"),
        ([0.1, 0.4], [], "l_wrist is corrected twice in frame 1"),
    ],
)
def test_corrections(points: list[float], bad: list[tuple[int, int]], said: str) -> None:
    places = tuple(Correction(1, "l_wrist", (x, 0.2, 1.0)) for x in points)
    with pytest.raises(InputError, match=said):
        Corrections(Path("t"), places, tuple(bad)).check(tracks.walker(6))


def test_a_joint_that_is_put_outside_of_the_room() -> None:
    grid = VoxelGrid(np.zeros(3), 0.1, (20, 20, 20))
    inside, outside = (Correction(1, "l_wrist", (x, 0.2, 1.0)) for x in (2.9, 1000.0))
    Corrections(Path("t"), (inside,)).check_places(grid)
    with pytest.raises(InputError, match=r"put to \[1000.0, 0.2, 1.0\]; expected a place in"):
        Corrections(Path("t"), (outside,)).check_places(grid)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("/bodyset/pelvis", "/bodyset/talus_l"), "not to pelvis"),
        (lambda text: '<!DOCTYPE a [<!ENTITY b "c">]>' + text, "a document type"),
    ],
)
def test_models_of_opensim(tmp_path: Path, change: Callable[[str], str], said: str) -> None:
    path = write_model(tmp_path / "m.osim")
    path.write_text(change(path.read_text()))
    with pytest.raises(InputError) as error:
        read_model(path)
    assert said in str(error.value) and "m.osim" in str(error.value)


@pytest.mark.parametrize("pattern", ["x/**a/[*", "**a", "["])
def test_patterns(pattern: str) -> None:
    said = "matches no file" if pattern == "[" else r"damaged or of .* expected a pattern such as"
    with pytest.raises(InputError, match=f"{re.escape(pattern)}: {said}"):
        read_raw(Path(pattern))
