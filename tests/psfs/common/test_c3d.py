"""Points of C3D files, in paths that ezc3d does not accept."""

import os
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np

from psfs.calibration.start.motion_capture import read_measured_wand


def test_a_wand_of_a_file_whose_name_is_not_utf8(tmp_path: Path) -> None:
    places = np.zeros((4, 2, 5))
    places[3], places[0, 1], places[1] = 1, 500, 1000
    file: Any = ezc3d.c3d()
    point = file["parameters"]["POINT"]
    point["RATE"]["value"], point["UNITS"]["value"] = [50.0], ["MM"]
    point["LABELS"]["value"] = ["near", "far"]
    file["data"]["points"] = places
    file.write(str(tmp_path / "wand.c3d"))
    path = (tmp_path / "wand.c3d").rename(tmp_path / os.fsdecode(b"\xff.c3d"))
    found = read_measured_wand(path, None, range(2), 25.0, 0.0)
    assert found.known is not None and list(found.known) == [0, 1]
    np.testing.assert_allclose(found.known[1], [[0, 1, 0], [0.5, 1, 0]])
