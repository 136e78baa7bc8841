"""The playback clock, without a window."""

import pytest

from psfs.page.timeline import SPEEDS, Playback


def test_frames_come_at_the_time_that_they_were_taken() -> None:
    playback = Playback(range(10, 20), 10.0, 10)
    playback.advance(5.0)
    assert playback.frame == 10  # paused
    playback.toggle()
    seen = []
    for _ in range(20):
        playback.advance(0.05)
        seen.append(playback.frame)
    assert seen[1::2] == [*range(11, 20), 10]  # and round again
    assert playback.time == pytest.approx(1.0)


def test_speed_and_gaps() -> None:
    """A frame is shown until the next one's time; the last as long as the one before."""
    playback = Playback([0, 10, 20], 10.0, 0)
    playback.toggle()
    playback.change_speed(1)
    assert playback.speed == 2
    shown = []
    for _ in range(9):
        playback.advance(0.25)
        shown.append(playback.frame)
    assert shown == [0, 10, 10, 20, 20, 0, 0, 10, 10]
    for _ in range(20):
        playback.change_speed(-1)
    assert playback.speed == SPEEDS[0]


def test_steps_and_seeks_go_round() -> None:
    playback = Playback([3, 5, 9], 30.0, 5)
    playback.toggle()
    for by, frame in ((1, 9), (1, 3), (-1, 9), (-2, 3)):
        playback.step(by)
        assert playback.frame == frame and not playback.playing
    playback.seek(2)
    playback.toggle()
    playback.advance(1 / 30)
    assert playback.frame == 9  # for four frames, as long as there is to the one before it
    playback.advance(3.5 / 30)
    assert playback.frame == 3
