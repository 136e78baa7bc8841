"""Cameras of different frame rates are shifted by frames of their own."""

from pathlib import Path

import numpy as np
from helpers import footage

from psfs.footage.timing import Timing
from psfs.sequence import Sequence


def test_lags_of_the_sequence_in_frames_of_each_camera(tmp_path: Path) -> None:
    assert Timing((60.0, 30.0, 15.0)).count_own_frames([3.2, 1.3, 0.9]) == [13, 3, 1]
    folder = footage.native(tmp_path, views=2, frames=1)
    # The first camera has twice the rate; both show the same times, the second from 2/5 s on.
    footage.write_video(folder / "videos" / "cam01.mp4", list(range(0, 240, 10)), 10.0)
    footage.write_video(folder / "videos" / "cam02.mp4", list(range(40, 240, 20)), 5.0)
    sequence = Sequence.open(folder)
    assert sequence.fps == 5
    shifted = sequence.synchronise({"cam01": 2})
    assert shifted.settings.sync == {"cam01": 4}
    images = shifted.read(1).images
    assert images is not None
    np.testing.assert_allclose(images.mean(axis=(1, 2, 3)), 60, atol=footage.LOSS)
