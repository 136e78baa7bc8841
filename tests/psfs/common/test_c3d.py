"""Points of C3D files, in paths that ezc3d does not accept."""

import os
from pathlib import Path

import numpy as np
from helpers.footage import write_c3d

from psfs.calibration.start.motion_capture import read_measured_wand


def test_a_wand_of_a_file_whose_name_is_not_utf8(tmp_path: Path) -> None:
    places = np.tile([[0.0, 1000, 0], [500, 1000, 0]], (5, 1, 1))
    write_c3d(tmp_path / "wand.c3d", places, ("near", "far"), 50.0, unit="MM")
    path = (tmp_path / "wand.c3d").rename(tmp_path / os.fsdecode(b"\xff.c3d"))
    found = read_measured_wand(path, None, range(2), 25.0, 0.0)
    assert found.known is not None and list(found.known) == [0, 1]
    np.testing.assert_allclose(found.known[1], [[0, 1, 0], [0.5, 1, 0]])
