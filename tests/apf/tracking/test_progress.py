"""The time that a take is expected to take."""

import io

import pytest
from rich.console import Console

from apf.tracking.progress import AGAIN, BY_FRAMES, ProgressLine, make_stage_bar
from psfs.common.bars import PROGRESS, StatedProgress


@pytest.mark.parametrize("slower", [0.7, 1.0, 1.4])
def test_end_of_a_take_is_known_after_a_tenth(slower):
    """Of stages that all take so much longer than expected, the end is within 1.5 times."""
    clock, bar, ends = [0.0], make_stage_bar(Console(file=io.StringIO())), []
    bar.get_time = lambda: clock[0]
    line = ProgressLine(bar)
    line.expect(["overlay"], is_gpu=True)
    line("opening")
    line.n_frames = n_frames = 300
    for stage, cost in line._costs.items():
        n = n_frames if stage in BY_FRAMES else 1
        for _ in range(n):
            line(stage)
            ends.append((clock[0], bar.tasks[0].fields["end"]))
            clock[0] += slower * (cost.whole + n_frames * cost.frame) / n
    assert AGAIN.keys() < line._costs.keys()
    for now, end in ends:
        if now > clock[0] / 10:
            assert 1 / 1.5 < end / clock[0] < 1.5


def test_process_that_started_a_command_follows_its_bar(tmp_path, monkeypatch):
    file = tmp_path / "progress.json"
    assert StatedProgress.read(file) == StatedProgress()
    monkeypatch.setenv(PROGRESS, str(file))
    with make_stage_bar(Console(file=io.StringIO())) as bar:
        line = ProgressLine(bar)
        line.n_frames = 10
        line("examining")
        line("tracking")
        bar.get_renderable()
        stated = StatedProgress.read(file)
    assert stated.words == "tracking 1/10" and 0 < stated.share < 1
    assert stated.left is not None and stated.left > 0
