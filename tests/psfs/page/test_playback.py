"""The playback clock, without a window."""

import numpy as np

from psfs.page.timeline import SPEEDS, Playback


def test_frames_come_at_the_time_that_they_were_taken() -> None:
    playback = Playback(np.arange(10, 20) / 10.0)
    playback.advance(5.0)
    assert playback.position == 0  # paused
    playback.playing = True
    seen = []
    for _ in range(20):
        playback.advance(0.05)
        seen.append(playback.position)
    assert seen[1::2] == [*range(1, 10), 0]  # and round again


def test_speed_and_gaps() -> None:
    """A frame is shown until the next one's time; the last as long as the one before."""
    playback = Playback(np.array([0, 10, 20]) / 10.0)
    playback.playing = True
    playback.change_speed(1)
    assert playback.speed == 2
    shown = []
    for _ in range(9):
        playback.advance(0.25)
        shown.append(playback.position)
    assert shown == [0, 1, 1, 2, 2, 0, 0, 1, 1]
    for _ in range(20):
        playback.change_speed(-1)
    assert playback.speed == SPEEDS[0]


def test_seeks_pause_and_go_round() -> None:
    playback = Playback(np.array([3, 5, 9]) / 30.0)
    playback.playing = True
    for wanted, position in ((3, 0), (-1, 2)):
        playback.seek(wanted)
        assert playback.position == position and not playback.playing
    playback.playing = True
    playback.advance(1 / 30)
    assert playback.position == 2  # for four frames, as long as there is to the one before it
    playback.advance(3.5 / 30)
    assert playback.position == 0
