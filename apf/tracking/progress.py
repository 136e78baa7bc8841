"""The progress of a take through the stages of its tracking."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from datetime import timedelta
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

log = logging.getLogger(__name__)


class _Cost(NamedTuple):
    """Seconds that a stage takes, and those of each frame, of a take with six cameras of 640 x 480
    on an H200 with 16 cores."""

    whole: float
    frame: float = 0.0


#: In their order: the stages before people are known, those of each person, one after the other,
#: until the start, both passes over all people together, and the results of each person.
_FOR_ALL = {"opening": _Cost(0.3), "examining": _Cost(5.5), "people": _Cost(0.6)}
_START = {"volume": _Cost(0.1), "start": _Cost(2.5)}
_FIRST = {
    "preparing": _Cost(0.4),
    **{"tracking": _Cost(0, 0.006), "tracking back": _Cost(0, 0.005), "fitting": _Cost(0.5, 0.006)},
}
AGAIN = {f"{stage} again": cost for stage, cost in _FIRST.items()}
_RESULTS = {"overlay": _Cost(0, 0.02), "checking": _Cost(2)}
_PASSES = _FIRST | AGAIN | {"completing": _Cost(0.5, 0.003)}
_ROUNDS = (_FOR_ALL, _START, _PASSES, _RESULTS)
_COSTS = {stage: cost for stages in _ROUNDS for stage, cost in stages.items()}
_ORDER = tuple(_COSTS)
#: The stages that report after every frame.
BY_FRAMES = frozenset(
    ("tracking", "tracking back", "tracking again", "tracking back again", "overlay")
)
#: Factors of both on two cores without a GPU.
_CPU = _Cost(2.0, 8.0)
#: Seconds of work that count as done in the expected time, beside what was done.
_PRIOR = 5.0


class StageProgress(ABC):
    """Receiver of a take's progress: called with the name of the current stage, see `track_take`,
    after every frame of stages that work by frames; and of what there is to tell, which is logged
    unless a subclass shows it."""

    def __init__(self) -> None:
        self._n_frames, self._whose, self._stage = 0, "", ""
        self._done: Counter[str] = Counter()
        self._costs, self._together = _COSTS, 1

    @property
    def n_frames(self) -> int:
        """Number of frames of the track. Setting it begins another track, as of the next person."""
        return self._n_frames

    @n_frames.setter
    def n_frames(self, number: int) -> None:
        self._n_frames, self._whose, self._together = number, "", 1
        self._done.clear()

    def begin_person(self, n_frames: int, number: int, of: int) -> None:
        """Begin the next round of stages of one of several people, counted from 1."""
        self.n_frames = n_frames
        self._whose = f"person {number} of {of}: " if of > 1 else ""

    def begin_everybody(self, n_frames: Sequence[int]) -> None:
        """Begin the passes over all people together, of whom each has so many frames."""
        self.n_frames, self._together = round(sum(n_frames) / len(n_frames)), len(n_frames)

    def expect(self, left_out: Collection[str], is_gpu: bool) -> None:
        """Learn which stages there will not be, and the kind of device."""
        by = _Cost(1.0, 1.0) if is_gpu else _CPU
        self._costs = {
            stage: _Cost(by.whole * cost.whole, by.frame * cost.frame)
            for stage, cost in _COSTS.items()
            if stage not in left_out
        }

    @abstractmethod
    def __call__(self, stage: str) -> None:
        """Report that a stage goes on, or has finished a frame."""

    def begin(self, stage: str) -> None:
        """Begin a stage, before its first frame."""
        self._done[stage] = 0
        self._enter(stage)

    @abstractmethod
    def _enter(self, stage: str) -> None:
        """Make a stage the current one; it goes on where it left off."""

    def warn(self, text: str) -> None:
        """Tell of a fault."""
        log.warning(text)

    def note(self, text: str) -> None:
        """Tell what was guessed."""
        log.info(text)

    def tell(self, text: str) -> None:
        """Tell what was found."""
        log.info(text)


class ProgressLine(StageProgress):
    """A line in `bar` on one take: its stage, the share of the work that is done, the time left."""

    def __init__(self, bar: Progress) -> None:
        super().__init__()
        self._bar = bar
        self._furthest = 0  # the last of the person's stages so far, in their order
        self._person, self._n_people = 1, 1
        self._task = bar.add_task("opening", total=None, end=None)

    def begin_person(self, n_frames: int, number: int, of: int) -> None:
        super().begin_person(n_frames, number, of)
        self._person, self._n_people, self._furthest = number, of, 0

    def __call__(self, stage: str) -> None:
        self._done[stage] += 1
        self._enter(stage)

    def _enter(self, stage: str) -> None:
        self._stage = stage
        if stage in _ORDER:
            self._furthest = max(self._furthest, _ORDER.index(stage))
        n = self._n_frames
        counted = f" {self._count(stage)}/{n}" if stage in BY_FRAMES else ""
        words = f"{self._whose}{stage}{counted}"
        done, whole = self._measure_work()
        now = next(task for task in self._bar.tasks if task.id == self._task).elapsed or 0.0
        end = now + (whole - done) * (now + _PRIOR) / (done + _PRIOR)
        self._bar.update(self._task, description=words, completed=done, total=whole, end=end)

    def _count(self, stage: str) -> int:
        """Return how many frames a stage has done, of each person."""
        return min(self._n_frames, self._done[stage] // self._together)

    def _measure_work(self) -> tuple[float, float]:
        """Return the work that is done, and all of it, in expected seconds."""
        n, done, whole = self._n_frames, 0.0, 0.0
        latest = next(stages for stages in _ROUNDS if _ORDER[self._furthest] in stages)
        for stage, cost in self._costs.items():
            people, size = 1 if stage in _FOR_ALL else self._n_people, cost.whole + n * cost.frame
            whole += people * size
            reached = _ORDER.index(stage) < self._furthest
            if stage not in latest:
                done += people * size if reached else 0.0
                continue
            now = self._count(stage) * cost.frame if stage in BY_FRAMES else size * reached
            together, before = (people, 0) if stage in _PASSES else (1, self._person - 1)
            done += together * now + (0 if stage in _FOR_ALL else before) * size
        return done, whole


def make_stage_bar(console: Console, hidden: bool = False) -> Progress:
    """Return the bar that shows a `ProgressLine` on a console of rich."""
    from rich.progress import (
        BarColumn,
        ProgressColumn,
        Task,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
    )
    from rich.text import Text

    from psfs.common.bars import FollowedProgress

    class TimeLeftColumn(ProgressColumn):
        """The time until the task's expected `end`, which goes on while a stage reports nothing."""

        def render(self, task: Task) -> Text:
            end = task.fields.get("end")
            if end is None:
                return Text("-:--:--", style="progress.remaining")
            left = timedelta(seconds=max(0, round(end - (task.elapsed or 0.0))))
            return Text(str(left), style="progress.remaining")

    return FollowedProgress(
        *(TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn()),
        *(TimeElapsedColumn(), TimeLeftColumn(), TextColumn("left")),
        console=console,
        disable=hidden,
    )


@contextmanager
def open_progress(progress: Callable[[str], object] | bool) -> Iterator[StageProgress]:
    """Return a context with the progress of a take: that calls a function with the stages' names,
    or, for true, that shows a line on a terminal and in a notebook."""
    if not progress or callable(progress):
        yield StageCalls(progress or None)
        return
    from rich.console import Console

    console = Console(stderr=True)
    bar = make_stage_bar(console, hidden=not (console.is_terminal or console.is_jupyter))
    with bar:
        yield ProgressLine(bar)


class StageCalls(StageProgress):
    """Progress that calls `report` with the name of the stage."""

    def __init__(self, report: Callable[[str], object] | None = None) -> None:
        super().__init__()
        self._report = report

    def __call__(self, stage: str) -> None:
        if self._report is not None:
            self._report(stage)

    def _enter(self, stage: str) -> None:
        pass
