"""Cameras whose clocks run differently are followed by silhouettes."""

from pathlib import Path

import numpy as np
from helpers import footage, scenes

from cl import NumpyDevice
from psfs.cameras.camera import CameraRig
from psfs.diagnostics.examination import synchronise
from psfs.sequence import Sequence
from psfs.session import Session

FRAMES, SIZE = 300, (96, 72)
#: By how many frames cameras come later, and seconds that their clocks count in one.
LATE, SPEEDS = np.array([0, 0, 3, 0]), np.array([1, 1, 1.008, 1])


def film(folder: Path, rig: CameraRig) -> Path:
    """Write masks of a body that wanders, turns and waves, as cameras of these clocks show it."""
    views = [
        [scenes.draw_points(camera, scenes.limbs((frame - late) / speed), 5)
         for frame in range(FRAMES)]
        for camera, late, speed in zip(rig, LATE, SPEEDS, strict=True)
    ]  # fmt: skip
    footage.write_take(folder, rig, views)
    (folder / "sequence.toml").write_text("fps = 30\n")
    return folder


def test_a_clock_that_runs_differently_is_followed(tmp_path: Path) -> None:
    rig = scenes.without_distortion(scenes.ring(len(LATE), SIZE, 3.2))
    opened = Sequence.open(film(tmp_path / "take", rig), sync="auto")
    followed = synchronise(Session(opened, NumpyDevice())).sequence
    ((name, (late, speed)),) = followed.settings.sync.items()
    assert name == "c2" and abs(late - LATE[2]) < 0.4 and abs(speed - SPEEDS[2]) < 5e-4
    (note,) = followed.timing_notes[:1]
    assert "c2 +" in note and "(its clock runs +0." in note
    times = (np.stack(followed.timing.clocks) * 30 - LATE[:, None]) / SPEEDS[:, None]
    assert len(followed) > FRAMES - 10 and np.ptp(times, axis=0).max() < 0.8
