"""What people are told of a live run's speed."""

from apf.live.pace import Pace, describe_run
from apf.live.session import LiveResult
from apf.live.timeline import Timeline


def timeline_of(rate: float, n: int = 10) -> Timeline:
    timeline = Timeline(("tracking",))
    for number in range(n):
        timeline.add_result(number, number / rate, number / rate + 0.2)
    return timeline


def test_what_is_to_be_expected() -> None:
    slow = Pace(4.0, 30.0, 0.2, 0.05, 0.5)
    assert not slow.keeps_up and "about 4.0 poses per second" in str(slow)
    assert slow.advice.startswith("faster with smaller pictures (--scale 0.25), a smaller search")
    assert Pace(4.0, 30.0, 0.05, 0.2, 0.5).advice.startswith("faster with a smaller search")
    assert Pace(28.0, 30.0, 0.02, 0.01, 1.0).keeps_up


def test_a_lost_person_is_told() -> None:
    class Lost:
        lost = True

    result = LiveResult([0, 1], [[Lost()], [Lost()]], [0.1, 0.1], [(0, 96, 10)])  # type: ignore[list-item]
    assert describe_run(result, timeline_of(8.0, 2)).endswith("LOST")
